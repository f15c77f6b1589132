"""From a configuration without lines to entities of Home Assistant, by clicks in the panel."""

import time
from pathlib import Path

from home_assistant.figures import note
from home_assistant.home import started_broker
from home_assistant.instance import HomeAssistant
from home_assistant.releases import NEW
from panel.browser import chromium, visitor
from panel.clicks import set_up
from panel.house import panel_house

LONGEST_S = 60.0
WANTED = "wisco__garage__do_1_switch"


def test_what_is_saved_in_the_panel_is_in_home_assistant(tmp_path: Path) -> None:
    """Modules of unknown address, baud rate and protocol; within a minute besides the search."""
    with (
        started_broker(tmp_path / "broker") as broker,
        panel_house(tmp_path / "house", lines="", broker=broker) as house,
        HomeAssistant(NEW) as assistant,
        chromium() as browser,
        visitor(browser, house.url, width=1000) as page,
    ):
        assistant.add_broker(broker.port)
        began = time.monotonic()
        _, search_s = set_up(
            page, house.config, lambda name: page.screenshot(path=tmp_path / f"{name}.png")
        )
        while WANTED not in (found := assistant.live.entities()):
            assert time.monotonic() - began < 3 * LONGEST_S, sorted(found)
            time.sleep(0.1)
        all_s = time.monotonic() - began
        note("panel", f"entities {all_s:.1f} s after the first click, {search_s:.1f} s the search")
        assistant.live.wait_state(found[WANTED]["entity_id"], "off")
        names = [entry["original_name"] for entry in found.values()]
        assert "Lamp" in names
        assert "Door" in names
        assert all_s - search_s < LONGEST_S
