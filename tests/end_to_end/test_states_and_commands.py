"""Frames on a line, a real mosquitto, the real daemon: states out, commands in."""

import json
from collections.abc import Iterator
from datetime import datetime

import pytest
from support.mqtt_probe import MqttProbe
from support.panel import BASE, STATIONS, House
from support.panel import house as running_house

from bridge.model import LineProtocol


@pytest.fixture(params=list(LineProtocol), ids=str, scope="module")
def house(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[House]:
    """The whole on one line of each protocol, online."""
    with running_house(tmp_path_factory.mktemp("house"), request.param) as running:
        yield running


def test_an_input_that_toggles_is_on_its_topic(house: House) -> None:
    """Each of the 16 inputs is published as it changes, ON and OFF."""
    module = house.line.module(1)
    for channel in range(1, 17):
        for value, word in ((True, "ON"), (False, "OFF")):
            house.probe.clear()
            module.set_input(channel, value)
            house.probe.wait_message(f"{BASE}/garage/di/{channel}", word)
            snapshot = json.loads(house.probe.wait_message(f"{BASE}/garage").payload)
            assert snapshot["di"][str(channel)] == word


@pytest.mark.parametrize("station_id", STATIONS)
def test_each_output_takes_on_off_and_toggle(house: House, station_id: str) -> None:
    """ON and OFF of each, TOGGLE of the first and the last: relay, state and verdict agree."""
    address, model = STATIONS[station_id]
    module = house.line.module(address)
    for channel in range(1, model.outputs + 1):
        bit = 1 << (channel - 1)
        for word, value in (("ON", bit), ("TOGGLE", 0), ("TOGGLE", bit), ("OFF", 0))[
            :: 1 if channel in {1, model.outputs} else 3
        ]:
            house.probe.clear()
            verdict = house.command(f"{station_id}/do/{channel}/set", {"state": word})
            assert verdict["status"] == "done"
            assert (verdict["target"], verdict["payload"]) == (f"do/{channel}", word)
            assert module.outputs & bit == value
            topics = [message.topic for message in house.probe.seen]
            state, result = f"{BASE}/{station_id}/do/{channel}", f"{BASE}/{station_id}/result"
            assert topics.index(state) < topics.index(f"{BASE}/{station_id}") < topics.index(result)


@pytest.mark.parametrize("station_id", STATIONS)
def test_all_outputs_at_once_are_one_write_on_the_wire(house: House, station_id: str) -> None:
    """`B/S/set` switches every output of the module in one frame, and reads it back."""
    address, model = STATIONS[station_id]
    module = house.line.module(address)
    everything = {str(n): "ON" for n in range(1, model.outputs + 1)}
    for wish, value in (
        (everything, (1 << model.outputs) - 1),
        (
            {n: "ON" if int(n) % 2 else "OFF" for n in everything},
            int("01" * 8, 2) & (1 << model.outputs) - 1,
        ),
        (dict.fromkeys(everything, "OFF"), 0),  # last: other tests find it as it was
    ):
        before = len(module.switchings)
        verdict = house.command(f"{station_id}/set", {"do": wish})
        assert (verdict["status"], verdict["target"], verdict["payload"]) == ("done", "do", wish)
        assert module.outputs == value
        ordered = list(module.switchings)[before:]
        assert len(ordered) == model.outputs
        assert len({(switching.at, switching.frame) for switching in ordered}) == 1


@pytest.mark.parametrize("station_id", STATIONS)
def test_modes_and_hold_times_are_set_and_published(house: House, station_id: str) -> None:
    """Written where they differ, read back, published before the verdict; the output obeys them."""
    address, model = STATIONS[station_id]
    module = house.line.module(address)
    last = model.outputs
    output, before = f"{station_id}/do/{last}", module.eeprom_writes
    wishes: list[tuple[str, object]] = [("mode", "pulse"), ("hold", 0.3), ("hold", 0.3)]
    for setting, wish in wishes:  # the last is so already: not written
        house.probe.clear()
        verdict = house.command(f"{output}/{setting}/set", {setting: wish})
        assert verdict["status"] == "done"
        assert (verdict["target"], verdict["payload"]) == (f"do/{last}/{setting}", wish)
    assert module.settings.pulse == 1 << (last - 1)
    assert module.settings.hold_ds[last - 1] == 3
    assert module.eeprom_writes == before + 2
    house.probe.clear()
    assert house.command(f"{output}/set", {"state": "PRESS"})["status"] == "done"
    house.probe.wait_message(f"{BASE}/{output}", "OFF")
    house.probe.clear()
    verdict = house.command(f"{output}/mode/set", {"mode": "latch"})
    assert verdict["status"] == "done"
    topics = [message.topic for message in house.probe.seen]
    assert topics.index(f"{BASE}/{output}/mode") < topics.index(f"{BASE}/{station_id}/result")
    assert house.command(f"{output}/set", {"state": "PRESS"})["reason"] == "bad_payload"


def test_diagnostics_tell_how_line_and_stations_are_doing(house: House) -> None:
    """Diagnostics come about 5 s after the start, and are retained for later subscribers."""
    of_line, of_station = f"{BASE}/bridge/line/main/diagnostics", f"{BASE}/garage/diagnostics"
    with MqttProbe(house.mosquitto.port, of_line, of_station) as late:
        line = json.loads(late.wait_message(of_line).payload)
        station = json.loads(late.wait_message(of_station).payload)
    assert line["cycle_ms"]["p50"] > 0
    assert line["counters"]["good"] > 10
    assert 0.5 <= line["utilisation"] <= 1
    assert station["reply_ms"]["p50"] > 0
    assert station["poll_ms"]["p50"] > 0
    assert datetime.fromisoformat(station["last_seen"]).tzinfo is not None
