"""Every page of the panel: usable by all, at every size, in both themes and both languages."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from bridge.commission.cabinet import read_cabinet
from bridge.commission.settings import WantedOutput
from bridge.protocol.wisco_eeprom import EEPROM_BYTES
from panel.browser import TABS, terminal, violations, visitor
from panel.house import PASSWORD, PanelHouse, panel_house
from panel.ingress import ingress

BACKUP_WITHIN_MS = 120_000.0  # the bridge has other work on its line
WIDTHS = (360, 800, 1600)
THEMES = ("light", "dark")
SIZES = [(width, theme) for width in WIDTHS for theme in THEMES]


@pytest.mark.parametrize(("width", "theme"), SIZES)
@pytest.mark.parametrize("tab", TABS)
def test_axe_finds_nothing(
    browser: Browser, house: PanelHouse, tab: str, width: int, theme: str
) -> None:
    """Names, roles, contrast; and nothing is wider than the screen."""
    with visitor(browser, f"{house.url}#{tab}", width=width, scheme=theme) as page:
        expect(page.get_by_role("link").nth(TABS.index(tab))).to_have_attribute(
            "aria-current", "page"
        )
        page.wait_for_timeout(700)  # a configuration is checked
        assert violations(page) == []
        assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.parametrize(("width", "theme"), SIZES)
def test_axe_finds_nothing_in_a_question(
    browser: Browser, house: PanelHouse, width: int, theme: str
) -> None:
    """The dialog of modes and hold times; nothing is written when it is left."""
    with visitor(browser, house.url, width=width, scheme=theme) as page:
        page.get_by_role("button", name="Settings: Garage, Gate").click()
        expect(page.get_by_role("dialog")).to_be_visible()
        assert violations(page) == []
        page.keyboard.press("Escape")
        expect(page.get_by_role("dialog")).to_be_hidden()


def test_the_keyboard_is_enough(browser: Browser, house: PanelHouse) -> None:
    """A lamp is switched with Tab and Enter alone."""
    with visitor(browser, house.url) as page:
        lamp = page.get_by_role("button", name=re.compile("Switch O.*: Garage, Lamp"))
        expect(lamp).to_be_enabled()
        for _ in range(60):
            page.keyboard.press("Tab")
            if lamp.evaluate("one => one === document.activeElement"):
                break
        page.keyboard.press("Enter")
        expect(terminal(page, "Garage", "Lamp")).to_contain_text(re.compile("done, [0-9]+ ms"))


def test_thai_is_complete(browser: Browser, house: PanelHouse) -> None:
    """By the language of the browser, or by a press; no word is left in English."""
    with visitor(browser, house.url, language="th-TH") as page:
        expect(page.get_by_role("link", name="โมดูล", exact=True)).to_be_visible()
        expect(page.locator("html")).to_have_attribute("lang", "th")
        page.get_by_role("button", name="English").click()
        expect(page.get_by_role("link", name="Modules", exact=True)).to_be_visible()


def test_a_pulse_and_a_cover_are_drawn_as_such(browser: Browser, house: PanelHouse) -> None:
    """A pulse output is a button with its hold time; a read-only one has none."""
    with visitor(browser, house.url) as page:
        page.get_by_role("button", name="Press 0.5 s: Garage, Gate").click()
        expect(terminal(page, "Garage", "Gate")).to_contain_text("done")
        expect(terminal(page, "Garage", "Siren").get_by_role("button")).to_have_count(0)
        expect(terminal(page, "Garage", "Siren")).to_contain_text("read only")
        page.get_by_role("button", name="Open: Shutter").click()
        cover = terminal(page, "Garage", "Shutter")
        expect(cover).to_contain_text("opening")
        page.get_by_role("button", name="Stop: Shutter").click()
        expect(cover).to_contain_text("stopped")


def test_an_input_is_live(browser: Browser, house: PanelHouse) -> None:
    """With its LED, its word and when it changed."""
    with visitor(browser, house.url) as page:
        row = terminal(page, "Garage", "Door")
        for on in (True, False):
            house.module.set_input(1, on)
            expect(row).to_contain_text("ON" if on else "OFF")
            expect(row).to_contain_text("s ago")
        page.get_by_role("link", name="What happened").click()
        expect(page.get_by_role("listitem").filter(has_text="Garage, Door").first).to_be_visible()
        page.get_by_role("searchbox").fill("nothing like this")
        expect(page.get_by_role("listitem").filter(has_text="Garage, Door")).to_have_count(0)


@pytest.mark.parametrize(("width", "output"), [(360, 11), (800, 12), (1600, 13)])
def test_no_row_moves_when_it_tells_of_a_change(
    browser: Browser, house: PanelHouse, width: int, output: int
) -> None:
    """Its place is kept free: what is about to be pressed stays where it is."""
    with visitor(browser, house.url, width=width) as page:
        pumps = page.get_by_role("article", name="Pumps")
        row = pumps.get_by_role("listitem").nth(output - 1)
        expect(row).to_contain_text("OFF")
        before = pumps.get_by_role("listitem").last.bounding_box()
        house.line.module(2).set_output(output, True)
        expect(row).to_contain_text("s ago")
        assert pumps.get_by_role("listitem").last.bounding_box() == before


def test_a_trace_starts_and_stops(browser: Browser, house: PanelHouse) -> None:
    """What passes on the line, decoded."""
    with visitor(browser, f"{house.url}#lines") as page:
        page.get_by_role("button", name="Start a trace of this line: main").click()
        expect(page.get_by_label("What passes on the line")).to_contain_text("read inputs")
        page.get_by_role("button", name="Stop the trace: main").click()


def test_a_problem_stands_beside_its_line(browser: Browser, house: PanelHouse) -> None:
    """In the text of the configuration, while it is typed; and it is not saved."""
    before = house.config.read_text()
    with visitor(browser, f"{house.url}#config") as page:
        text = page.get_by_role("textbox")
        expect(text).to_have_value(before)
        text.fill(before.replace("baud: 9600", "baud: 9601"))
        expect(page.get_by_role("button", name="line 7, column 11")).to_be_visible()
        expect(page.locator(".gutter .wrong")).to_have_text(re.compile("7"))
        page.get_by_role("button", name="Save").click()
        expect(page.get_by_role("status").filter(has_text="1 problems")).to_be_visible()
    assert house.config.read_text() == before


def test_a_backup_is_made_and_downloaded(
    browser: Browser, house: PanelHouse, tmp_path: Path
) -> None:
    """Of the modules that are there; the one that is away is named. Nothing is written."""
    writes = house.module.eeprom_writes
    with visitor(browser, f"{house.url}#config") as page:
        page.get_by_role("button", name="Make a backup").click()
        fetched = page.get_by_role("link", name="Download it")
        expect(fetched).to_be_visible(timeout=BACKUP_WITHIN_MS)
        expect(page.get_by_role("status").filter(has_text="dead: it is offline")).to_be_visible()
        assert violations(page) == []
        with page.expect_download() as got:
            fetched.click()
        got.value.save_as(tmp_path / "cabinet.zip")
    assert got.value.suggested_filename.startswith("wisco2mqtt-")
    garage, pumps = read_cabinet(tmp_path / "cabinet.zip").modules
    assert bytes(garage.content().values()) == house.module.read_eeprom(0, EEPROM_BYTES)
    assert garage.wanted()[1] == WantedOutput(2, pulse=True, hold_ds=5)
    assert pumps.station_id == "pumps"
    assert house.module.eeprom_writes == writes


def test_behind_a_path_and_another_name(browser: Browser, tmp_path: Path) -> None:
    """As Home Assistant's ingress shows it: with its password, its events and its commands."""
    keys = f', password: "{PASSWORD}", proxy: 127.0.0.1'
    with (
        panel_house(tmp_path / "behind", keys=keys) as house,
        ingress(house.web) as url,
        visitor(browser, url) as page,
    ):
        page.get_by_label("Password").fill(PASSWORD)
        page.keyboard.press("Enter")
        page.get_by_role("button", name="Switch ON: Garage, Lamp").click()
        expect(terminal(page, "Garage", "Lamp")).to_contain_text("done")
        page.get_by_role("link", name="Configuration").click()
        expect(page.get_by_role("textbox")).to_have_value(re.compile("'\\*\\*\\*'"))
    assert house.module.outputs & 1


@pytest.mark.parametrize(("width", "theme"), SIZES)
def test_a_password_is_asked_for(browser: Browser, tmp_path: Path, width: int, theme: str) -> None:
    """Before it nothing is shown; with it everything; and one can log out again."""
    with (
        panel_house(tmp_path / "locked", keys=f', password: "{PASSWORD}"') as locked,
        visitor(browser, locked.url, width=width, scheme=theme) as page,
    ):
        page.get_by_label("Password").fill("wrong")
        page.get_by_role("button", name="Log in").click()
        expect(page.get_by_role("alert")).to_contain_text("wrong key")
        assert violations(page) == []
        assert "Garage" not in page.content()
        page.get_by_label("Password").fill(PASSWORD)
        page.keyboard.press("Enter")
        expect(page.get_by_role("heading", name="Garage")).to_be_visible()
        page.get_by_role("button", name="Log out").click()
        expect(page.get_by_label("Password")).to_be_visible()
