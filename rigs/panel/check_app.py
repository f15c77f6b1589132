"""The app of Home Assistant from its options to a house: a stub Supervisor, and an ingress."""

import json
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from home_assistant.former import extract
from playwright.sync_api import Browser, Page, expect
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe, held_at

from panel.browser import terminal, visitor
from panel.clicks import set_up
from panel.container import SECRET, USER, Container, container
from panel.house import PASSWORD
from panel.ingress import ingress

# The first whose panel the ingress reaches; its configuration names no `config_version` yet.
_FORMER = "26e7c88"
_LINES = """\
lines:
  - id: main
    port: {port}
    baud: 19200
    protocol: modbus-rtu
    stations:
      - address: 7
        model: DIO100
        id: garage
        name: Garage
        inputs: {{5: {{name: Water meter, count: true}}}}
        outputs: {{1: {{name: Lamp}}}}
      - {{address: 12, model: DO100, id: pumps}}
"""


def test_from_the_options_to_a_house_and_a_restart(browser: Browser, tmp_path: Path) -> None:
    """The first start is an empty house; a restart switches nothing."""
    with container(tmp_path / "app") as (app, broker), ingress(app.web) as url:
        with app.started():
            _set_up(app, broker, browser, url)
        orders, kept = _orders(app), app.config.read_text()
        assert SECRET not in kept
        assert PASSWORD not in kept
        with app.started():
            _look(broker, browser, url)
        assert _orders(app) == orders
        assert app.config.read_text() == kept


def test_an_update_and_a_backup_keep_all_and_switch_nothing(
    browser: Browser, tmp_path: Path
) -> None:
    """A former release, this one on its folders, and this one restored into an empty place."""
    former = tmp_path / "former"
    extract(_FORMER, former)
    with container(tmp_path / "app") as (app, broker), ingress(app.web) as url:
        with app.started(former):
            pass
        lines = _LINES.format(port=app.line.port)
        app.config.write_text(app.config.read_text().replace("lines: []\n", lines))
        with app.started(former):
            _use(app, broker)
        orders, kept, before = _orders(app), app.config.read_text(), _announced(broker)
        assert "config_version" not in kept
        with app.started(), _probe(broker) as probe:
            _look(broker, browser, url)
            assert before.items() <= _announced(broker).items()
            assert not [one.topic for one in probe.seen if one.topic in before and not one.payload]
            _count(app, broker, "4")
            restored = app.restored(tmp_path / "restored")
        shutil.rmtree(app.folder)
        assert json.loads(_counts(restored)) == {"garage/di/5": 3}  # as the former one left it
        with restored.started():
            _look(broker, browser, url)
            _count(restored, broker, "5")
        assert _orders(app) == orders
        assert restored.config.read_text() == kept


def _set_up(app: Container, broker: Mosquitto, browser: Browser, url: str) -> None:
    with opened(browser, url) as page, _probe(broker) as probe:
        expect(page.get_by_role("article")).to_have_count(0)
        set_up(page, app.config, lambda _: None)
        probe.wait_for(lambda seen: any("wisco__garage" in one.topic for one in seen))
        page.get_by_role("button", name="Switch ON: Garage, Lamp").click()
        expect(terminal(page, "Garage", "Lamp")).to_contain_text("done")
        assert app.line.module(7).outputs & 1


def _use(app: Container, broker: Mosquitto) -> None:
    with _probe(broker) as probe:
        probe.wait_message("wisco/bridge/state", "online")
        probe.wait_message("wisco/garage/di/5", "OFF")
        probe.publish("wisco/garage/do/1/set", "ON")
        probe.wait_message("wisco/garage/do/1", "ON")
    for count in ("1", "2", "3"):
        _count(app, broker, count)


def _look(broker: Mosquitto, browser: Browser, url: str) -> None:
    """It is online, and as it was: on the broker, and in the panel with its password."""
    with _probe(broker) as probe:
        probe.wait_message("wisco/bridge/state", "online")
        probe.wait_message("wisco/garage/availability", "online")
        probe.wait_message("wisco/garage/do/1", "ON")
    with opened(browser, url) as page:
        expect(terminal(page, "Garage", "Lamp")).to_contain_text("ON")


def _count(app: Container, broker: Mosquitto, count: str) -> None:
    """One edge more; `count` is what is counted then."""
    with _probe(broker) as probe:
        app.line.module(7).set_input(5, True)
        probe.wait_message("wisco/garage/di/5/count", count)
        probe.clear()
        app.line.module(7).set_input(5, False)
        probe.wait_message("wisco/garage/di/5", "OFF")


def _counts(app: Container) -> str:
    return (app.data / "counts-wisco.json").read_text()


def _orders(app: Container) -> list[Counter[tuple[int, bool]]]:
    """Return how often each output was ordered, counted by the modules."""
    return [module.ordered.copy() for module in app.line.modules.values()]


def _announced(broker: Mosquitto) -> dict[str, set[str]]:
    """Return the components of each device that the broker retains for Home Assistant."""
    filters = ("homeassistant/device/#",)
    held = held_at(broker.port, *filters, username=USER, password=SECRET)
    return {topic: set(json.loads(text)["components"]) for topic, text in held.items()}


def _probe(broker: Mosquitto) -> MqttProbe:
    return MqttProbe(broker.port, "wisco/#", "homeassistant/#", username=USER, password=SECRET)


@contextmanager
def opened(browser: Browser, url: str) -> Iterator[Page]:
    """The panel through the ingress, with its password."""
    with visitor(browser, url) as page:
        page.get_by_label("Password").fill(PASSWORD)
        page.keyboard.press("Enter")
        expect(page.get_by_label("Password")).to_be_hidden()
        yield page
