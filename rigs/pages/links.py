"""Looks at every link of the site as it was built: `python -m pages.links FOLDER`."""

import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class _Seen(HTMLParser):
    """The links and the anchors of one page."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.anchors: set[str] = {""}
        self.feed(page.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note where it leads, and what leads to it."""
        for name, value in attrs:
            if name in {"href", "src"} and value:
                self.links.add(value)
            if (name == "id" or (tag == "a" and name == "name")) and value:
                self.anchors.add(value)


def dead_links(site: Path) -> tuple[int, list[str]]:
    """Return the number of links within the site, and those that lead nowhere."""
    pages = {page: _Seen(page) for page in sorted(site.rglob("*.html"))}
    links = [
        (page, link)
        for page, seen in pages.items()
        if page.name != "404.html"  # its links begin at the root of the server
        for link in sorted(seen.links)
        if not urlsplit(link).scheme and not urlsplit(link).netloc
    ]
    return len(links), [f"{page}: {link}" for page, link in links if not _leads(page, link, pages)]


def _leads(page: Path, link: str, pages: dict[Path, _Seen]) -> bool:
    parts = urlsplit(link)
    target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
    target = target / "index.html" if target.is_dir() else target
    if target not in pages:
        return target.is_file()
    return unquote(parts.fragment) in pages[target].anchors


def outside(site: Path) -> Iterator[str]:
    """Yield what a page would fetch from other machines."""
    for page in sorted(site.rglob("*.html")):
        text = page.read_text()
        for found in ("fonts.googleapis", "fonts.gstatic", "cdn.", "unpkg.com"):
            if found in text:
                yield f"{page}: {found}"


def main() -> int:
    """Print the figures; exit with 1 where a link is dead, or a page needs another machine."""
    site = Path(sys.argv[1]).resolve()
    count, dead = dead_links(site)
    fetched = list(outside(site))
    print(*dead, *fetched, sep="\n", end="\n" if dead or fetched else "")
    print(
        f"{count} links within the site, {len(dead)} dead; {len(fetched)} to fetch from elsewhere"
    )
    return bool(dead or fetched)


if __name__ == "__main__":
    sys.exit(main())
