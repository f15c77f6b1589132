"""What mkdocs does besides: pages from outside of docs/, and the page of the HTTP interface."""

import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from posixpath import dirname, normpath, relpath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "rigs"))

from pages.openapi import page_of  # noqa: E402  # mkdocs loads this file by its path

# Files of the repository that pages of docs/ lead to, and their places in the site.
PLACES = {
    "README.md": "project/clone.md",
    "CHANGELOG.md": "project/changes.md",
    "config.example.yaml": "project/config.example.yaml",
    "packaging/home-assistant/wisco2mqtt/DOCS.md": "project/app.md",
    "packaging/image/compose.yaml": "project/compose.yaml",
}
_MARK = re.compile(r"(?:-|[0-9]+\.) ")
_LINK = re.compile(r"(\]\()(?![a-z]+:|#)([^)#\s]+)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the files from outside of docs/, and what is made of openapi.yaml."""
    for name, place in PLACES.items():
        files.append(File.generated(config, place, abs_src_path=str(ROOT / name)))
    routes = page_of((ROOT / "docs" / "openapi.yaml").read_text())
    files.append(File.generated(config, "routes.md", content=routes))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Let links that leave docs/, or come from outside of it, lead to the places in the site."""
    place = page.file.src_uri
    source = next((name for name, at in PLACES.items() if at == place), f"docs/{place}")

    def moved(found: re.Match[str]) -> str:
        target = normpath(f"{dirname(source)}/{found[2]}".lstrip("/"))
        there = PLACES.get(target, target.removeprefix("docs/"))
        return found[1] + relpath(there, dirname(place) or ".")

    return "\n".join(_deeper(_LINK.sub(moved, markdown).splitlines()))


def _deeper(lines: Iterable[str]) -> Iterator[str]:
    """Yield the lines with 4 spaces before what belongs to an item of a list.

    Elsewhere the width of the mark decides, such as 3 spaces below `1. `; mkdocs wants 4.
    """
    missing, in_code = 0, False
    for line in lines:
        indent = len(line) - len(line.lstrip())
        in_code ^= line.startswith("```")
        mark = None if in_code else _MARK.match(line)
        if mark or (line and not indent):
            missing = 4 - len(mark[0]) if mark else 0
        yield " " * missing + line if missing and indent >= 4 - missing else line
