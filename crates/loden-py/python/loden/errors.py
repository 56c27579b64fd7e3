"""The exceptions of the package.

Each has the attributes ``path``, the file it is about, and ``field``, the field of that file or the name of a
parameter; either is None where there is none.
"""

from __future__ import annotations

__all__ = [
    "CancelledError",
    "Error",
    "FileError",
    "InvalidFileError",
    "LimitError",
    "MissingFileError",
    "NotConvergedError",
    "NotFiniteError",
    "OutputExistsError",
    "ParameterError",
    "UnsupportedError",
]


class Error(Exception):
    """Base of all exceptions of this package."""

    path: str | None
    field: str | None

    def __init__(self, message: str, path: str | None = None, field: str | None = None) -> None:
        super().__init__(message)
        self.path = path
        self.field = field

    def __reduce__(self) -> tuple[type[Error], tuple[str, str | None, str | None]]:
        return type(self), (str(self), self.path, self.field)

    def __str__(self) -> str:
        return str(self.args[0])


class FileError(Error, OSError):
    """The operating system reported an error: no permission, a full disk."""


class MissingFileError(FileError, FileNotFoundError):
    """A file or folder does not exist."""


class OutputExistsError(Error, FileExistsError):
    """An output exists already; pass ``overwrite=True`` to replace it."""


class InvalidFileError(Error, ValueError):
    """A file's content contradicts its format."""


class UnsupportedError(Error, ValueError):
    """A file is of a kind, or uses a feature, that is not supported."""


class LimitError(Error, ValueError):
    """A file asks for more than the limits allow."""


class ParameterError(Error, ValueError):
    """An argument is out of range, of the wrong shape, or contradicts another."""


class NotFiniteError(Error, ValueError):
    """Data hold numbers that are not finite."""


class NotConvergedError(Error, ArithmeticError):
    """An iterative computation did not converge."""


class CancelledError(Error):
    """The work was cancelled."""
