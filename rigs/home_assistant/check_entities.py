"""Every kind of entity, as the real Home Assistant has it: there, switching, and up to date."""

import re
import time
from dataclasses import dataclass
from typing import Any

import pytest
from home_assistant.home import Home
from home_assistant.house import wait_until

AT_ONCE_S = 1.0

# The garage as its owner sees it: entity id, category, class.
GARAGE = {
    "binary_sensor.wisco_garage_di_1": (None, "door"),
    "binary_sensor.wisco_garage_di_2": (None, "motion"),
    **{f"binary_sensor.wisco_garage_di_{n}": (None, None) for n in (3, 4, *range(6, 17))},
    "event.wisco_garage_di_3": (None, "button"),
    "sensor.wisco_garage_di_4": (None, "water"),
    "light.wisco_garage_do_1": (None, None),
    "button.wisco_garage_do_2": (None, None),
    "binary_sensor.wisco_garage_do_2": (None, None),
    "binary_sensor.wisco_garage_do_3": (None, None),
    "switch.wisco_garage_do_4": (None, None),
    "valve.wisco_garage_do_5": (None, None),
    "lock.wisco_garage_do_6": (None, None),
    "siren.wisco_garage_do_7": (None, None),
    "fan.wisco_garage_do_8": (None, None),
    **{f"select.wisco_garage_do_{n}_mode": ("config", None) for n in (1, 4, 5, 6, 7)},
    **{f"number.wisco_garage_do_{n}_hold": ("config", "duration") for n in (1, 4, 5, 6, 7)},
    "binary_sensor.wisco_garage_connectivity": ("diagnostic", "connectivity"),
    "binary_sensor.wisco_garage_problem": ("diagnostic", "problem"),
    "event.wisco_garage_result": ("diagnostic", None),
    "sensor.wisco_garage_last_refusal": ("diagnostic", None),
    "sensor.wisco_garage_own_action": ("diagnostic", None),
    "sensor.wisco_garage_poll_time": ("diagnostic", "duration"),
    "sensor.wisco_garage_reply_time": ("diagnostic", "duration"),
    "sensor.wisco_garage_errors": ("diagnostic", None),
    "sensor.wisco_garage_last_seen": ("diagnostic", "timestamp"),
}
# Disabled by default; the tests of modes and hold times enable these.
SETTINGS = [
    entity
    for n in ("garage_do_4", "cellar_do_1")
    for entity in (f"select.wisco_{n}_mode", f"number.wisco_{n}_hold")
]
FIGURES = ("poll_time", "reply_time", "errors", "last_seen")


@dataclass(frozen=True, slots=True)
class Service:
    """A service, the relay of the garage that it moves, and what comes back as the state."""

    name: str
    entity_id: str
    output: int
    on: bool
    state: str


SERVICES = [
    Service(f"{domain}.{service}", f"{domain}.wisco_garage_do_{output}", output, on, state)
    for domain, output, services in (
        ("light", 1, (("turn_on", True, "on"), ("turn_off", False, "off"))),
        ("light", 1, (("toggle", True, "on"), ("toggle", False, "off"))),
        ("switch", 4, (("turn_on", True, "on"), ("turn_off", False, "off"))),
        ("switch", 4, (("toggle", True, "on"), ("toggle", False, "off"))),
        ("valve", 5, (("open_valve", True, "open"), ("close_valve", False, "closed"))),
        ("lock", 6, (("unlock", True, "unlocked"), ("lock", False, "locked"))),
        ("siren", 7, (("turn_on", True, "on"), ("turn_off", False, "off"))),
        ("siren", 7, (("toggle", True, "on"), ("toggle", False, "off"))),
        ("fan", 8, (("turn_on", True, "on"), ("turn_off", False, "off"))),
        ("fan", 8, (("toggle", True, "on"), ("toggle", False, "off"))),
    )
    for service, on, state in services
]


def test_the_garage_is_as_its_owner_sees_it(everything: Home) -> None:
    """Each entity has the id, the category and the class that the guide tells."""
    device = everything.assistant.live.devices()["wisco__garage"]
    found = {
        entry["entity_id"]: (entry["entity_category"], entry["original_device_class"])
        for entry in everything.assistant.live.entities().values()
        if entry["device_id"] == device["id"]
    }
    assert found == GARAGE


def test_every_announced_entity_is_there_as_announced(everything: Home) -> None:
    """None is missing, none is too much, and ids, device, category and class are right."""
    live = everything.assistant.live
    wanted, known, devices = everything.announced, live.entities(), live.devices()
    assert set(known) == set(wanted)
    for unique_id, one in wanted.items():
        entry = known[unique_id]
        domain, _, name = one["default_entity_id"].partition(".")
        slug = re.sub(r"[-_]+", "_", name)  # homeassistant/util/__init__.py: slugify
        assert entry["entity_id"] == f"{domain}.{slug}"
        assert entry["device_id"] == devices[one["identifier"]]["id"]
        assert entry["entity_category"] == one.get("entity_category")
        assert entry["original_device_class"] == one.get("device_class")
        off_by_default = not one.get("enabled_by_default", True)
        assert entry["disabled_by"] == ("integration" if off_by_default else None)
    everything.note(f"{len(known)} entities on {len(devices)} devices, as announced")


def test_the_devices_say_what_they_are(everything: Home) -> None:
    """Name and model; stations are reached through the bridge, and a room is suggested."""
    devices = everything.assistant.live.devices()
    bridge = devices.pop("wisco__bridge")
    assert (bridge["name"], bridge["manufacturer"]) == ("Wisco bridge", "wisco2mqtt")
    assert {name: (one["name"], one["model"]) for name, one in devices.items()} == {
        "wisco__garage": ("Garage ä", "DIO100"),
        "wisco__cellar": ("Cellar", "DO100"),
        "wisco__north-wing_2": ("North wing", "DIO100"),
        "wisco__annex_02": ("annex_02", "DO100"),
    }
    assert {one["via_device_id"] for one in devices.values()} == {bridge["id"]}
    assert {name: one["area_id"] for name, one in devices.items()} == {
        "wisco__garage": "yard",
        "wisco__cellar": None,
        "wisco__north-wing_2": "annex",
        "wisco__annex_02": None,
    }


@pytest.mark.parametrize("service", SERVICES, ids=lambda one: f"{one.name}-{one.state}")
def test_a_service_switches_the_relay_and_comes_back_as_state(
    everything: Home, service: Service
) -> None:
    """The simulated relay moves, and the state that Home Assistant shows is the module's."""
    live, module = everything.assistant.live, everything.house.module("garage")
    assert live.state(service.entity_id) != service.state
    began = time.monotonic()
    live.call(service.name, service.entity_id)
    shown = live.wait_state(service.entity_id, service.state, AT_ONCE_S)
    assert bool(module.outputs >> (service.output - 1) & 1) is service.on
    everything.note_slowest("a command of a service", shown.at - began)


def test_a_button_gives_one_pulse(everything: Home) -> None:
    """A press of a button gives one pulse, and the indicator follows the output."""
    live, module = everything.assistant.live, everything.house.module("garage")
    before = module.ordered[2, True]
    live.call("button.press", "button.wisco_garage_do_2")
    live.wait_state("binary_sensor.wisco_garage_do_2", "on", AT_ONCE_S)
    live.wait_state("binary_sensor.wisco_garage_do_2", "off")
    assert module.ordered[2, True] == before + 1


def test_a_cover_of_no_known_position_is_unknown(everything: Home) -> None:
    """After a start of the bridge no button of the cover is disabled."""
    everything.assistant.live.wait_state("cover.wisco_annex_02_cover_shutter", "unknown")


def test_a_cover_opens_stops_closes_and_takes_a_position(everything: Home) -> None:
    """Each service drives one of its two relays; what it does and where it is comes back."""
    live, module = everything.assistant.live, everything.house.module("annex_02")
    cover, began = "cover.wisco_annex_02_cover_shutter", len(module.switchings)
    live.call("cover.close_cover", cover)
    live.wait_state(cover, "closing", AT_ONCE_S)
    live.wait_state(cover, "closed")
    live.call("cover.open_cover", cover)
    live.wait_state(cover, "opening", AT_ONCE_S)
    assert module.outputs == 0b01
    live.call("cover.stop_cover", cover)
    live.wait_state(cover, "open", AT_ONCE_S)
    assert module.outputs == 0
    live.call("cover.set_cover_position", cover, position=70)
    live.wait_state(cover, "opening", AT_ONCE_S + 1.0)  # and the dead time, where there is one
    live.wait_state(cover, "open")
    assert live.states[cover].attributes["current_position"] in range(65, 80)
    live.call("cover.close_cover", cover)
    live.wait_state(cover, "closed")
    assert live.states[cover].attributes["current_position"] == 0
    assert [(s.output, s.value) for s in list(module.switchings)[began:]] == [
        (2, True), (2, False), (1, True), (1, False), (1, True), (1, False), (2, True), (2, False),
    ]  # fmt: skip


@pytest.mark.parametrize("mode", ["pulse", "latch"])
def test_a_mode_is_written_to_the_module(everything: Home, mode: str) -> None:
    """A selected mode is written to the module, and shown as read from it."""
    live, module = everything.assistant.live, everything.house.module("garage")
    live.enable(SETTINGS)
    live.wait_for(
        lambda states: all(
            one in states and states[one].state not in {"unavailable", "unknown"}
            for one in SETTINGS
        )
    )
    live.call("select.select_option", "select.wisco_garage_do_4_mode", option=mode)
    live.wait_state("select.wisco_garage_do_4_mode", mode)
    assert bool(module.settings.pulse >> 3 & 1) is (mode == "pulse")


@pytest.mark.parametrize(
    ("value", "state"), [(2.5, "2.5"), (0.3, "0.3"), (25.5, "25.5"), (7, "7.0")]
)
def test_a_hold_time_is_written_to_the_module(everything: Home, value: float, state: str) -> None:
    """Any tenth of a second, and whole ones too."""
    live, module = everything.assistant.live, everything.house.module("garage")
    live.call("number.set_value", "number.wisco_garage_do_4_hold", value=value)
    live.wait_state("number.wisco_garage_do_4_hold", state)
    assert module.settings.hold_ds[3] == round(value * 10)


def test_a_verdict_is_an_event(everything: Home) -> None:
    """An automation that waits for the event hears what became of the command."""
    live = everything.assistant.live
    wanted = {"event_type": "done", "target": "do/4", "payload": "ON", "status": "done"}
    live.call("switch.turn_on", "switch.wisco_garage_do_4")
    live.wait_for(
        lambda states: wanted.items() <= states["event.wisco_garage_result"].attributes.items(),
        otherwise=lambda: str(live.states["event.wisco_garage_result"]),
    )
    live.call("switch.turn_off", "switch.wisco_garage_do_4")
    live.wait_state("switch.wisco_garage_do_4", "off")


def test_the_automation_of_the_guide_tells_what_was_not_switched(everything: Home) -> None:
    """The automation of the guide reports that the boiler, which is read-only, was not switched."""
    everything.house.probe.publish("wisco/garage/do/3/set", "ON")
    title = "Garage: do/3 was not switched"
    wait_until(lambda: title in _notifications(everything), "the notification")
    assert _notifications(everything)[title] == "read_only"
    live = everything.assistant.live
    live.wait_state("sensor.wisco_garage_last_refusal", "do/3: read only")
    assert everything.house.module("garage").ordered[3, True] == 0


def _notifications(everything: Home) -> dict[str, str]:
    found = everything.assistant.live.ask("persistent_notification/get")
    return {one["title"]: one["message"] for one in found}


def test_a_press_is_an_event_and_fires_its_trigger(everything: Home) -> None:
    """Each gesture has a device trigger, and the event entity says which it was."""
    live, button = everything.assistant.live, everything.house.module("garage")
    device = live.devices()["wisco__garage"]
    offered = live.ask("device_automation/trigger/list", device_id=device["id"])
    triggers = {one["type"]: one for one in offered if one["domain"] == "mqtt"}
    assert set(triggers) == {
        "button_short_press",
        "button_long_press",
        "button_double_press",
    }
    live.watch_trigger(triggers["button_short_press"])
    began = time.monotonic()
    button.set_input(3, True)
    live.wait_state("binary_sensor.wisco_garage_di_3", "on")
    button.set_input(3, False)
    assert live.wait_trigger()["topic"] == "wisco/garage/di/3/event"
    live.wait_for(
        lambda states: states["event.wisco_garage_di_3"].attributes["event_type"] == "short"
    )
    everything.note_slowest("a short press", time.monotonic() - began)


def test_a_meter_counts(everything: Home) -> None:
    """Each edge is half a litre."""
    live, meter = everything.assistant.live, everything.house.module("garage")
    litres = live.states["sensor.wisco_garage_di_4"].state
    assert litres is not None
    for n in range(1, 4):
        meter.set_input(4, True)
        live.wait_state("sensor.wisco_garage_di_4", str(float(litres) + n / 2))
        meter.set_input(4, False)
        live.wait_state("binary_sensor.wisco_garage_di_4", "off")


def test_every_input_is_shown_at_once(everything: Home) -> None:
    """Each input of each station, there and back: its state arrives within a second."""
    for line in everything.house.config.lines:
        for config in line.stations:
            for channel in config.inputs:
                for level in (True, False):
                    took_s = _drive(everything, config.id, channel.channel, level, channel.invert)
                    everything.note_slowest("a change of an input", took_s)
                    assert took_s < AT_ONCE_S


def test_a_rule_is_switched_off_and_on(everything: Home) -> None:
    """Its switch is among the settings of the bridge; while it is off, its input does nothing."""
    live, module = everything.assistant.live, everything.house.module("north-wing_2")
    rule, button = "switch.wisco_bridge_rule_corridor", "binary_sensor.wisco_north_wing_2_di_9"
    assert live.state(rule) == "on"
    for service, state, orders in (("turn_off", "off", 0), ("turn_on", "on", 1)):
        live.call(f"switch.{service}", rule)
        live.wait_state(rule, state, AT_ONCE_S)
        before = module.ordered.total()
        module.set_input(9, True)
        live.wait_state(button, "on", AT_ONCE_S)
        module.set_input(9, False)
        live.wait_state(button, "off", AT_ONCE_S)
        time.sleep(AT_ONCE_S)
        assert module.ordered.total() - before == orders


def _drive(everything: Home, station_id: str, channel: int, level: bool, invert: bool) -> float:
    slug = station_id.replace("-", "_")
    entity_id = f"binary_sensor.wisco_{slug}_di_{channel}"
    state = "on" if level is not invert else "off"
    live = everything.assistant.live
    began = time.monotonic()
    everything.house.module(station_id).set_input(channel, level)
    if live.state(entity_id) == state:
        return 0.0  # the first level of an inverted input is the one that it has
    return live.wait_state(entity_id, state).at - began


def test_a_station_that_goes_away_is_unavailable_and_says_why(everything: Home) -> None:
    """Of a station that is away only connection and problem are available, with the reason."""
    live, module = everything.assistant.live, everything.house.module("cellar")
    module.away = True
    live.wait_state("switch.wisco_cellar_do_1", "unavailable")
    live.wait_state("binary_sensor.wisco_cellar_connectivity", "off")
    problem = live.wait_state("binary_sensor.wisco_cellar_problem", "on")
    assert problem.attributes["reason"] == "no_reply"
    module.away = False
    live.wait_state("switch.wisco_cellar_do_1", "off")
    live.wait_state("binary_sensor.wisco_cellar_connectivity", "on")
    live.wait_state("binary_sensor.wisco_cellar_problem", "off")


def test_settings_that_cannot_be_read_are_unknown(everything: Home) -> None:
    """A module comes back that takes Wisco frames alone: it cannot be told its modes any more."""
    live, module = everything.assistant.live, everything.house.module("cellar")
    for wisco_only, mode, hold in ((True, "unknown", "unknown"), (False, "latch", "1.0")):
        module.away = True
        live.wait_state("switch.wisco_cellar_do_1", "unavailable")
        module.wisco_only, module.away = wisco_only, False
        live.wait_state("select.wisco_cellar_do_1_mode", mode)
        live.wait_state("number.wisco_cellar_do_1_hold", hold)
        live.wait_state("switch.wisco_cellar_do_1", "off")


def test_figures_show_once_they_are_enabled(everything: Home) -> None:
    """Figures are disabled by default; an enabled one shows a number or an instant."""
    live = everything.assistant.live
    stations = ("garage", "cellar", "north_wing_2", "annex_02")
    wanted = [f"sensor.wisco_{station_id}_{name}" for station_id in stations for name in FIGURES]
    wanted += [f"sensor.wisco_bridge_line_main_{name}" for name in ("cycle", "utilisation")]
    live.enable(wanted)
    live.wait_for(
        lambda states: all(
            one in states and states[one].state not in {"unavailable", "unknown"} for one in wanted
        )
    )
    states = live.states
    for entity_id in wanted:
        text = states[entity_id].state
        assert text is not None
        if entity_id.endswith("last_seen"):
            assert re.fullmatch(r"\d{4}-\d\d-\d\dT.*", text)
        else:
            assert float(text) >= 0
    attributes: dict[str, Any] = states["sensor.wisco_garage_errors"].attributes
    assert {"silent", "bad", "refused", "last_error"} <= set(attributes)


def test_nobody_complains(everything: Home) -> None:
    """After all that the log has no warning and no error of the MQTT component."""
    complaints = everything.assistant.complaints()
    everything.note(f"{len(complaints)} warnings and errors of the MQTT component")
    assert complaints == []


def test_home_assistant_can_complain(everything: Home) -> None:
    """Home Assistant logs a wrong announcement, so an empty log above means no fault."""
    everything.house.probe.publish("homeassistant/switch/other/bad/config", '{"name": "bad"}')
    wait_until(lambda: bool(everything.assistant.complaints()), "a complaint")
