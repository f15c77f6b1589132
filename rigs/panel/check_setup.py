"""A house is set up in the panel: from no lines to modules, and to what is announced of them."""

from pathlib import Path

from playwright.sync_api import Browser
from support.mqtt_probe import MqttProbe

from panel.browser import violations, visitor
from panel.clicks import set_up
from panel.house import panel_house

LONGEST_S = 60.0


def test_from_nothing_to_modules_that_are_announced(browser: Browser, tmp_path: Path) -> None:
    """Their address, baud rate and protocol are found; one output blinks, after a question."""
    with panel_house(tmp_path / "empty", lines="") as house:
        house.daemon.wait_for_log("there are no lines yet")
        with (
            MqttProbe(house.broker.port, "homeassistant/#") as probe,
            visitor(browser, house.url, width=800) as page,
        ):

            def look(name: str) -> None:
                page.screenshot(path=tmp_path / f"{name}.png", full_page=True)
                assert violations(page) == [], name

            all_s, search_s = set_up(page, house.config, look)
            probe.wait_for(lambda seen: any("wisco__garage" in one.topic for one in seen))
        orders = [(one.output, one.value) for one in house.line.module(7).switchings if one.frame]
        assert orders == [(1, True), (1, False)]
        assert not house.line.module(12).switchings
    print(f"set up in {all_s:.1f} s, {search_s:.1f} s of it the search")
    assert all_s - search_s < LONGEST_S
