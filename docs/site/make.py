#!/usr/bin/env python3
"""Builds the documentation site into target/site: `make site`.

usage: make.py PROGRAM

The guide and the other pages of docs/ as they are; a page per command from its help, tables of formats, codecs, models and so on from
`loden list`, and the Python reference from the installed package. The pages ask no other machine for anything and search by themselves.
"""
import html
import inspect
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
DOCS, STAGED, SITE = ROOT / "docs", ROOT / "target" / "site-pages", ROOT / "target" / "site"
PAGES = ["formats", "format", "acquire", "rectify", "brdf", "scenes", "synthesis", "generate", "export", "studio", "benchmarks", "correctness", "release"]
REFERENCE = {
    "formats": "Formats that are read", "exporters": "Formats that are written", "codecs": "Codecs", "models": "Analytic models",
    "factorisations": "Factorisations", "syntheses": "Syntheses", "samples": "Samples", "renderers": "Other renderers",
}


def printed(*words):
    environment = {"NO_COLOR": "1", "PATH": "/usr/bin:/bin", "COLUMNS": "96"}
    return subprocess.run([PROGRAM, *words], check=True, capture_output=True, text=True, env=environment).stdout


def commands(words=()):
    """Every command as a list of words, with its subcommands behind it."""
    text = printed(*words, "--help") if words else printed("--help")
    listed = re.search(r"^Commands:\n((?:  .*\n|\n)+)", text, re.MULTILINE)
    names = re.findall(r"^  ([a-z]\S*)", listed.group(1), re.MULTILINE) if listed else []
    if words:
        yield list(words), text
    for name in names:
        if name != "help":
            yield from commands((*words, name))


def command_page(words, text):
    """The help of a command: its first lines as text, the rest as it is printed."""
    about, _, rest = text.partition("\nUsage:")
    return f"# loden {' '.join(words)}\n\n{html.escape(about.strip(), quote=False)}\n\n```text\nUsage:{rest.rstrip()}\n```\n"


def range_of(parameter):
    found = parameter["range"]
    if isinstance(found, str):
        return found
    words = [str(one).lower() if isinstance(one, bool) else f"{one:g}" if isinstance(one, (int, float)) else one for one in found]
    return f"{words[0]} to {words[1]}" if not isinstance(found[0], (str, bool)) else ", ".join(words)


def registry_page(title, rows):
    lines = [f"# {title}", ""]
    for row in rows:
        lines += [f"## {row['name']}", "", html.escape(row["doc"], quote=False), ""]
        if row["parameters"]:
            lines += ["| parameter | range | default | |", "|---|---|---|---|"]
            for one in row["parameters"]:
                default = one["default"]
                default = "" if default in ("", None) else json.dumps(default).strip('"')
                unit = f" {one['unit']}" if one["unit"] else ""
                cells = [f"`{one['name']}`", range_of(one) + unit, default, one["doc"]]
                lines.append("| " + " | ".join(html.escape(cell, quote=False).replace("|", "\\|") for cell in cells) + " |")
            lines.append("")
    return "\n".join(lines)


def python_page():
    import loden

    def entry(name, thing, level):
        text = inspect.getdoc(thing) or ""
        # objects of these classes are made by functions
        call = "" if inspect.isclass(thing) else f"```python\n{name}{inspect.signature(thing)}\n```\n\n"
        return f"{'#' * level} {name}\n\n{call}{text}\n"

    parts = [f"# Python\n\n{inspect.getdoc(loden)}\n"]
    for name in loden.__all__:
        thing = getattr(loden, name)
        if inspect.isclass(thing) and issubclass(thing, BaseException):
            parts.append(f"## {name}\n\n{inspect.getdoc(thing)} Base: `{thing.__mro__[1].__name__}`.\n")
        elif callable(thing):
            parts.append(entry(name, thing, 2))
            if inspect.isclass(thing):
                members = [member for member in vars(thing) if not member.startswith("_")]
                for member in members:
                    found = getattr(thing, member)
                    parts.append(entry(f"{name}.{member}", found, 3) if callable(found) else f"### {name}.{member}\n\n{inspect.getdoc(found) or ''}\n")
    text = re.sub(r" *# doctest: \+SKIP", "", "\n".join(parts))
    return re.sub(r"^>>>.*(?:\n(?!\n).*)*", lambda found: f"```python\n{found.group(0)}\n```", text, flags=re.MULTILINE)


def relinked(text, page):
    """Links that leave docs/ become plain text: the site has no sources."""

    def link(found):
        words, target = found.groups()
        if target.startswith(("http", "#")) or (page.parent / target.split("#")[0]).resolve().is_relative_to(DOCS):
            return found.group(0)
        return words if words.startswith("`") else f"{words} (`{target.lstrip('./')}`)"

    return re.sub(r"(?<!!)\[([^\]]*)\]\(([^)\s]+)\)", link, text)


def stage():
    shutil.rmtree(STAGED, ignore_errors=True)
    STAGED.mkdir(parents=True)
    pages = [*DOCS.glob("guide/*.md"), *(DOCS / f"{name}.md" for name in PAGES), DOCS / "gallery" / "README.md", DOCS / "sweep" / "README.md"]
    for page in pages:
        target = STAGED / page.relative_to(DOCS)
        target.parent.mkdir(exist_ok=True)
        target.write_text(relinked(page.read_text(), page))
    for folder in ("gallery", "images", "sweep"):
        for file in (DOCS / folder).iterdir():
            if file.suffix in (".jpg", ".png", ".html", ".py"):
                (STAGED / folder).mkdir(exist_ok=True)
                shutil.copy(file, STAGED / folder)
    readme = (ROOT / "README.md").read_text()
    # links of the front page are seen from docs/
    readme = re.sub(r"\]\(docs/", "](", readme)
    (STAGED / "index.md").write_text(relinked(readme, DOCS / "index.md"))
    shutil.copy(DOCS / "site" / "extra.css", STAGED)
    (STAGED / "reference").mkdir()
    for kind, rows in json.loads(printed("list", "--json")).items():
        (STAGED / "reference" / f"{kind}.md").write_text(registry_page(REFERENCE[kind], rows))
    (STAGED / "reference" / "python.md").write_text(python_page())
    (STAGED / "commands").mkdir()
    for words, text in commands():
        (STAGED / "commands" / f"{'-'.join(words)}.md").write_text(command_page(words, text))


def title(page):
    first = re.search(r"^# (.*)$", page.read_text(), re.MULTILINE)
    return first.group(1).replace("`", "") if first else page.stem


def navigation():
    entry = lambda path: {title(STAGED / path): path}
    every = lambda folder: [entry(f"{folder}/{page.name}") for page in sorted((STAGED / folder).glob("*.md"))]
    return [
        {"Home": "index.md"},
        {"Guide": every("guide")},
        {"Commands": every("commands")},
        {"Reference": [entry(f"reference/{kind}.md") for kind in [*REFERENCE, "python"]]},
        {"Topics": [entry(f"{name}.md") for name in PAGES] + [entry("sweep/README.md")]},
        {"Gallery": "gallery/README.md"},
    ]


def main():
    stage()
    configuration = json.loads((DOCS / "site" / "mkdocs.json").read_text())
    configuration |= {"docs_dir": str(STAGED), "site_dir": str(SITE), "nav": navigation(), "extra_css": ["extra.css"]}
    file = ROOT / "target" / "mkdocs.yml"
    # JSON is YAML
    file.write_text(json.dumps(configuration, indent=1))
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    subprocess.run([sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--config-file", file], check=True, env=environment)
    foreign = [page for page in SITE.rglob("*.html") if re.search(r"""<(?:script|link|img)[^>]+(?:src|href)=["']?https?:""", page.read_text())]
    if foreign:
        sys.exit(f"these pages ask other machines: {', '.join(str(page) for page in foreign)}")
    print(f"{len(list(SITE.rglob('*.html')))} pages in {SITE}")


PROGRAM = pathlib.Path(sys.argv[1]).resolve()
main()
