"""What the panel shows, and lets be pressed, when something is away."""

import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect
from support.daemon import Daemon
from support.tcp_relay import TcpRelay, Way

from panel.browser import terminal, visitor
from panel.house import PanelHouse, panel_house

LAMP = re.compile("Switch O.*: Garage, Lamp")


@pytest.fixture(name="house")
def _house(tmp_path: Path) -> Iterator[PanelHouse]:
    """A house of one's own for each test."""
    with panel_house(tmp_path / "house") as house:
        yield house


def _orders(house: PanelHouse) -> int:
    return sum(bool(one.frame) for one in house.module.switchings)


def _link(page: Page, text: str) -> None:
    expect(page.locator("#link")).to_contain_text(text)


def test_without_a_broker_it_shows_and_switches(browser: Browser, house: PanelHouse) -> None:
    """And says that the broker is away."""
    with visitor(browser, house.url) as page:
        _link(page, "broker: connected")
        house.broker.stop()
        _link(page, "broker: away")
        page.get_by_role("button", name="Switch ON: Garage, Lamp").click()
        expect(terminal(page, "Garage", "Lamp")).to_contain_text(re.compile("ON.*done", re.DOTALL))
        assert house.module.outputs & 1
        house.broker.start()
        _link(page, "broker: connected")


def test_a_dead_module_is_grey_and_says_why(browser: Browser, house: PanelHouse) -> None:
    """Its buttons cannot be pressed, and the others can."""
    with visitor(browser, house.url) as page:
        shed = page.get_by_role("article", name="Shed")
        expect(shed).to_contain_text("offline")
        expect(shed).to_contain_text("did not answer")
        expect(shed.get_by_role("button", name="Switch ON").first).to_be_disabled()
        expect(page.get_by_role("button", name=LAMP)).to_be_enabled()


def test_a_line_that_is_gone_takes_its_modules_along(browser: Browser, house: PanelHouse) -> None:
    """And brings them back."""
    with visitor(browser, house.url) as page:
        garage = page.get_by_role("article", name="Garage")
        expect(garage).to_contain_text("online")
        house.line.hang_up()
        expect(garage).to_contain_text("its line is offline")
        expect(page.get_by_role("button", name=LAMP)).to_be_disabled()
        house.line.restore()
        expect(page.get_by_role("button", name=LAMP)).to_be_enabled()


def test_a_refusal_is_told_where_it_was_pressed(browser: Browser, house: PanelHouse) -> None:
    """With the reason in words."""
    with visitor(browser, house.url) as page:
        page.get_by_role("button", name="Switch ON: Garage, Pump up").click()
        expect(terminal(page, "Garage", "Pump up")).to_contain_text("done")
        page.get_by_role("button", name="Switch ON: Garage, Pump down").click()
        expect(terminal(page, "Garage", "Pump down")).to_contain_text("refused: another output")


def test_a_restart_is_seen_and_lived_through(browser: Browser, house: PanelHouse) -> None:
    """Everything is grey meanwhile; then the page is that of the new run."""
    with visitor(browser, house.url) as page:
        expect(page.get_by_role("button", name=LAMP)).to_be_enabled()
        house.daemon.signal(signal.SIGKILL)
        house.daemon.process.wait(20)
        _link(page, "no connection to the bridge")
        expect(page.get_by_role("button", name=LAMP)).to_be_disabled()
        with Daemon(house.config) as again:
            _link(page, "connected")
            page.get_by_role("button", name="Switch ON: Garage, Lamp").click()
            expect(terminal(page, "Garage", "Lamp")).to_contain_text("done")
            again.stop()


def test_a_telephone_that_slept_for_an_hour_does_not_press_old_things(
    browser: Browser, house: PanelHouse
) -> None:
    """Its connection looks alive and brings nothing: what it shows is greyed when it wakes up."""
    with TcpRelay(house.web) as relay:
        with visitor(browser, "about:blank") as page:
            page.clock.install()
            page.goto(f"http://127.0.0.1:{relay.port}/")
            lamp = page.get_by_role("button", name=LAMP)
            expect(lamp).to_be_enabled()
            relay.stall()
            page.clock.fast_forward("01:00:00")
            _link(page, "no connection to the bridge")
            expect(lamp).to_be_disabled()
            house.module.set_input(1, True)
            relay.resume()
            relay.cut()  # the router forgot the connection long ago
            page.clock.fast_forward("00:10")
            expect(lamp).to_be_enabled()
            expect(terminal(page, "Garage", "Door")).to_contain_text("ON")
        assert _orders(house) == 0


def test_a_press_that_is_held_up_switches_nothing(browser: Browser, house: PanelHouse) -> None:
    """It arrives three seconds late: `expired`."""
    with TcpRelay(house.web) as relay:
        with visitor(browser, f"http://127.0.0.1:{relay.port}/") as page:
            lamp = page.get_by_role("button", name="Switch ON: Garage, Lamp")
            expect(lamp).to_be_enabled()
            relay.stall(Way.IN)
            lamp.click()
            page.wait_for_timeout(3000)
            relay.resume()
            expect(terminal(page, "Garage", "Lamp")).to_contain_text("too late")
        assert _orders(house) == 0
