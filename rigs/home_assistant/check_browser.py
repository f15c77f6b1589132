"""A finger at Home Assistant's own page: what it switches stays where it was put."""

from collections.abc import Iterator

import pytest
from home_assistant.browser import device_path, page
from home_assistant.home import Home, home, started_broker
from home_assistant.houses import EVERYTHING
from home_assistant.releases import NEW, OLD
from playwright.sync_api import Locator

_TOGGLES = 10
# The page takes back what nobody confirmed after 2 s: it is watched for longer than that.
_WATCHED_MS = 3_000
# Takes down every position that the switch is drawn in, once a frame.
_WATCH = """(toggle, milliseconds) => new Promise(resolve => {
  const seen = [toggle.checked];
  const end = performance.now() + milliseconds;
  const look = () => {
    if (toggle.checked !== seen[seen.length - 1]) seen.push(toggle.checked);
    performance.now() < end ? requestAnimationFrame(look) : resolve(seen);
  };
  toggle.click();
  look();
})"""


@pytest.fixture(
    params=[
        pytest.param((OLD, "single"), id="2024.3.3"),
        pytest.param((NEW, "device"), id="2026.11.0"),
    ]
)
def shown(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Home]:
    """Every kind of entity, in the form of discovery that fits each release best."""
    release, discovery = request.param
    directory = tmp_path_factory.mktemp("browser")
    with (
        started_broker(directory / "broker") as broker,
        home(directory / "house", broker, release, EVERYTHING, discovery) as built,
    ):
        yield built


def test_a_switch_never_bounces_back(shown: Home) -> None:
    """Each click moves it once, and the relay with it, while the module answers."""
    module = shown.house.module("garage")
    bounces = 0
    with page(shown.assistant, device_path(shown.assistant, "wisco__garage"), 1200, 1600) as garage:
        toggle = _toggle(garage.locator("hui-toggle-entity-row", has_text="Pump"))
        for n in range(1, _TOGGLES + 1):
            on = bool(n % 2)
            seen = toggle.evaluate(_WATCH, _WATCHED_MS)
            assert seen[0] is not on
            assert seen[-1] is on
            bounces += len(seen) - 2
            assert bool(module.outputs >> 3 & 1) is on
    shown.note(f"{_TOGGLES} clicks on the device page: {bounces} bounces")
    assert bounces == 0


def test_an_unknown_cover_has_all_its_buttons(shown: Home) -> None:
    """Its page disables none of them: up, stop and down."""
    annex = device_path(shown.assistant, "wisco__annex_02")
    assert shown.assistant.live.state("cover.wisco_annex_02_cover_shutter") == "unknown"
    with page(shown.assistant, annex, 1200, 1600) as drawn:
        buttons = drawn.locator("hui-cover-entity-row ha-cover-controls ha-icon-button")
        buttons.first.wait_for()
        disabled = buttons.evaluate_all("(all) => all.map(one => one.disabled)")
    shown.note(f"an unknown cover: {disabled.count(False)} of {len(disabled)} buttons enabled")
    assert disabled == [False, False, False]


def _toggle(row: Locator) -> Locator:
    found = row.locator("ha-switch").first
    found.wait_for()
    return found
