"""`make panel-pictures`: the pictures of docs/panel.md, from the real panel."""

import re
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Browser, Page, expect

from panel.browser import chromium, terminal, visitor
from panel.clicks import set_up
from panel.house import panel_house

PICTURES = Path("docs/pictures")
LARGEST_BYTES = 200_000
_WANTED = {"naming": "panel-find", "proposal": "panel-proposal"}


def main() -> int:
    """Draws each picture, and says how large it is."""
    PICTURES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="pictures-") as name, chromium() as browser:
        _modules(browser, Path(name))
        _setup(browser, Path(name))
    return 0


def _modules(browser: Browser, directory: Path) -> None:
    with panel_house(directory / "house") as house:
        with visitor(browser, house.url, width=1100, height=1150) as page:
            house.module.set_input(1, True)
            page.get_by_role("button", name="Switch ON: Garage, Lamp").click()
            expect(terminal(page, "Garage", "Lamp")).to_contain_text(re.compile("done"))
            page.get_by_role("button", name="Switch ON: Garage, Pump up").click()
            expect(terminal(page, "Garage", "Pump up")).to_contain_text("done")
            page.get_by_role("button", name="Switch ON: Garage, Pump down").click()
            expect(terminal(page, "Garage", "Pump down")).to_contain_text("refused")
            _draw(page, "panel-modules")
        with visitor(browser, house.url, width=360, height=780, scheme="dark") as page:
            expect(terminal(page, "Garage", "Door")).to_contain_text("ON")
            _draw(page, "panel-telephone")
        with visitor(browser, f"{house.url}#lines", width=1100, height=750) as page:
            page.get_by_role("button", name="Start a trace of this line: main").click()
            expect(page.get_by_label("What passes on the line")).to_contain_text("inputs ON")
            _draw(page, "panel-lines")


def _setup(browser: Browser, directory: Path) -> None:
    with (
        panel_house(directory / "empty", lines="") as house,
        visitor(browser, house.url, width=1000, height=900) as page,
    ):

        def picture(name: str) -> None:
            if name in _WANTED:
                place = "h2" if name == "naming" else "section h2"
                page.locator(place).first.evaluate("one => one.scrollIntoView()")
                _draw(page, _WANTED[name])

        set_up(page, house.config, picture)


def _draw(page: Page, name: str) -> None:
    path = PICTURES / f"{name}.png"
    page.screenshot(path=path)
    held = path.stat().st_size
    print(f"{path}: {held} bytes")
    if held > LARGEST_BYTES:
        sys.exit(f"{path} is larger than {LARGEST_BYTES} bytes")


if __name__ == "__main__":
    sys.exit(main())
