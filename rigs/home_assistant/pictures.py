"""`make home-assistant-pictures`: the pictures of docs/home-assistant.md, from the real pages."""

import sys
import tempfile
from pathlib import Path

from home_assistant.browser import device_path, page
from home_assistant.home import Home, home, started_broker
from home_assistant.houses import EVERYTHING
from home_assistant.releases import NEW
from playwright.sync_api import Page

PICTURES = Path("docs/pictures")
LARGEST_BYTES = 200_000
_SETTLED_MS = 1_500  # cards fade in


def main() -> int:
    """Draws each picture, and says how large it is."""
    PICTURES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="pictures-") as name:
        directory = Path(name)
        with (
            started_broker(directory / "broker") as broker,
            home(directory / "house", broker, NEW, EVERYTHING, "device") as shown,
        ):
            _liven(shown)
            _draw(shown, "wisco__garage", "Lamp", "home-assistant-station.png", (1200, 2150))
            _draw(shown, "wisco__bridge", "Connection", "home-assistant-bridge.png", (1200, 700))
    return 0


def _liven(shown: Home) -> None:
    """A lamp is on and a door is open: there is something to see."""
    shown.assistant.live.call("light.turn_on", "light.wisco_garage_do_1")
    shown.house.module("garage").set_input(1, True)
    shown.assistant.live.wait_state("binary_sensor.wisco_garage_di_1", "on")
    shown.assistant.live.wait_state("light.wisco_garage_do_1", "on")


def _draw(shown: Home, device: str, text: str, name: str, size: tuple[int, int]) -> None:
    path = PICTURES / name
    with page(shown.assistant, device_path(shown.assistant, device), *size) as drawn:
        _wait(drawn, text)
        drawn.screenshot(path=path)
    held = path.stat().st_size
    print(f"{path}: {held} bytes")
    if held > LARGEST_BYTES:
        sys.exit(f"{path} is larger than {LARGEST_BYTES} bytes")


def _wait(drawn: Page, text: str) -> None:
    drawn.get_by_text(text).first.wait_for()
    drawn.wait_for_timeout(_SETTLED_MS)


if __name__ == "__main__":
    sys.exit(main())
