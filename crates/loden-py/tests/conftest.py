import pathlib

import pytest

import loden


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> pathlib.Path:
    return tmp_path_factory.mktemp("samples")


@pytest.fixture(scope="session")
def archive(folder: pathlib.Path) -> pathlib.Path:
    """A small measured twill: 16 x 16 texels, 81 x 81 pairs, JPEG."""
    path = folder / "twill.zip"
    loden.acquire("twill", path, size=16, spp=1)
    return path


@pytest.fixture(scope="session")
def compressed(folder: pathlib.Path, archive: pathlib.Path) -> pathlib.Path:
    path = folder / "twill.loden"
    loden.compress(archive, path, method="pvmf", components=6)
    return path
