"""From a configuration without lines to modules with names, by clicks and names alone."""

import time
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page, expect

FOUND_WITHIN_MS = 120_000.0
MODULES = 2
_SEARCHES = 3  # on a machine that is busy a reply comes too late for a quick search


def set_up(page: Page, config: Path, picture: Callable[[str], object]) -> tuple[float, float]:
    """Do it; return the seconds of all, and of the search in it. `picture` keeps one by a name."""
    began = time.monotonic()
    page.get_by_role("link", name="Find modules").first.click()
    page.get_by_label("Port", exact=True).select_option(label="Simulated RS485 adapter")
    searched = time.monotonic()
    for _ in range(_SEARCHES):
        _search(page)
        if page.get_by_role("article").count() == MODULES:
            break
    expect(page.get_by_role("article")).to_have_count(MODULES)
    searched_s = time.monotonic() - searched
    _blink(page)
    garage = page.get_by_role("article").first
    garage.get_by_label("Name").first.fill("Garage")
    garage.get_by_label("Id (").fill("garage")
    garage.get_by_text("Names of Inputs").click()
    garage.get_by_label("input 1", exact=True).fill("Door")
    garage.get_by_text("Names of Outputs").click()
    garage.get_by_label("output 1", exact=True).fill("Lamp")
    picture("naming")
    page.get_by_role("button", name="Show the configuration").click()
    expect(page.get_by_text("valid", exact=True)).to_be_visible()
    picture("proposal")
    page.get_by_role("button", name="Save").click()
    expect(page.get_by_role("heading", name="Garage")).to_be_visible()
    expect(page.get_by_role("button", name="Switch ON: Garage, Lamp")).to_be_enabled()
    picture("there")
    assert "id: garage" in config.read_text()
    return time.monotonic() - began, searched_s


def _search(page: Page) -> None:
    page.get_by_role("button", name="Search").click()
    expect(page.get_by_role("button", name="Stop searching")).to_be_visible()
    expect(page.get_by_role("button", name="Stop searching")).to_be_hidden(timeout=FOUND_WITHIN_MS)


def _blink(page: Page) -> None:
    garage = page.get_by_role("article").first
    garage.get_by_role("button", name="Blink an output").click()
    page.get_by_role("dialog").get_by_role("button", name="Yes, blink it").click()
    expect(garage).to_contain_text("it blinked")
