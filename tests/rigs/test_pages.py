"""The site of the documentation: dead links are found, and the HTTP interface is a page."""

from pathlib import Path

import pytest
from pages.links import dead_links, outside
from pages.openapi import page_of

OPENAPI = Path(__file__).parents[2] / "docs" / "openapi.yaml"


@pytest.mark.parametrize(
    "link", ["gone.html", "b.html#gone", "#gone", "gone.png", "folder/", "../site/a.html#x"]
)
def test_a_link_that_leads_nowhere_is_dead(link: str, tmp_path: Path) -> None:
    """A missing page, file or anchor is named with its page."""
    (tmp_path / "a.html").write_text(f'<a href="{link}">there</a>')
    (tmp_path / "b.html").write_text('<h1 id="here">b</h1>')
    assert dead_links(tmp_path) == (1, [f"{tmp_path}/a.html: {link}"])


@pytest.mark.parametrize("link", ["b.html#here", "b.html", "#", "picture.png", "folder/", "."])
def test_a_link_that_leads_somewhere_is_none(link: str, tmp_path: Path) -> None:
    """Pages, anchors, files, and folders with a page."""
    (tmp_path / "index.html").write_text(f'<a href="{link}">there</a>')
    (tmp_path / "b.html").write_text('<h1 id="here">b</h1>')
    (tmp_path / "picture.png").touch()
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "index.html").touch()
    assert dead_links(tmp_path) == (1, [])


def test_what_comes_from_other_machines_is_named(tmp_path: Path) -> None:
    """The site has to be whole where there is no internet."""
    (tmp_path / "a.html").write_text('<link href="https://fonts.googleapis.com/css">')
    assert list(outside(tmp_path)) == [f"{tmp_path}/a.html: fonts.googleapis"]


def test_each_route_and_each_body_is_on_the_page() -> None:
    """Routes have their statuses, and bodies are links to their forms."""
    page = page_of(OPENAPI.read_text())
    assert "## POST /api/command" in page
    assert "Body: `application/json`: [Command](#command)" in page
    assert "| 404 | Why not | `application/json`: [Error](#error) |" in page
    assert "| `line` | integer | always |" in page
    assert "| `payload` | anything | always" in page
