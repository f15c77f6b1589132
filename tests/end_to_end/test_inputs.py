"""Hands at the inputs, a real mosquitto, the real daemon: what they tell besides their state."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.brokers import RETAIN_SHOWS, Broker
from support.daemon import Daemon
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, broker, is_complete, panel, write_config

from bridge.model import LineProtocol
from bridge.simulator.line import SimulatedLine

# Generous times: a busy machine makes no other gesture of a pattern.
QUICK, LONG, PATIENT, METER = 1, 2, 3, 7
INPUTS = (
    f"{QUICK}: {{gestures: {{long: 60s, double: 300ms}}}}, "
    f"{LONG}: {{gestures: {{long: 2s, double: 0s}}}}, "
    f"{PATIENT}: {{gestures: {{long: 60s, double: 10s}}}}, "
    f"{METER}: {{count: {{unit: L}}}}"
)
COUNT = f"{BASE}/garage/di/{METER}/count"


@dataclass
class House:
    """A panel with buttons and a meter, and a broker."""

    line: SimulatedLine
    mosquitto: Broker
    config: Path

    @property
    def file(self) -> Path:
        """Return the path of the counts file."""
        return self.config.with_name("counts-wisco.json")

    def kept(self) -> int:
        """Return the counts in the file."""
        count: int = json.loads(self.file.read_text())[f"garage/di/{METER}"]
        return count

    @contextmanager
    def run(self) -> Iterator[tuple[Daemon, MqttProbe]]:
        """The daemon, online, before a probe."""
        with MqttProbe(self.mosquitto.port, f"{BASE}/#") as probe, Daemon(self.config) as daemon:
            probe.wait_for(lambda seen: is_complete(seen) and any(m.topic == COUNT for m in seen))
            yield daemon, probe
            assert "Traceback" not in daemon.log

    def set(self, probe: MqttProbe, channel: int, *, on: bool) -> None:
        """Turns an input, and waits until that is published."""
        topic, word = f"{BASE}/garage/di/{channel}", "ON" if on else "OFF"
        before = len(probe.seen)
        self.line.module(1).set_input(channel, on)
        probe.wait_for(lambda seen: any((m.topic, m.text) == (topic, word) for m in seen[before:]))

    def press(self, probe: MqttProbe, channel: int) -> None:
        """Presses an input and lets it go."""
        self.set(probe, channel, on=True)
        self.set(probe, channel, on=False)


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    """All of it, but for the daemon."""
    with panel(LineProtocol.WISCO) as line, broker(tmp_path) as mosquitto:
        config = write_config(tmp_path, line, mosquitto.port)
        text = config.read_text()
        assert text.count("id: garage}") == 1
        config.write_text(text.replace("id: garage}", f"id: garage, inputs: {{{INPUTS}}}}}"))
        yield House(line, mosquitto, config)


def gestures(seen: list[Seen]) -> list[tuple[int, str]]:
    """Return the published presses: input and gesture."""
    events = [m for m in seen if m.topic.endswith("/event")]
    assert not any(message.retain for message in events)
    return [(int(m.topic.split("/")[-2]), json.loads(m.payload)["event_type"]) for m in events]


def counts(seen: list[Seen]) -> list[int]:
    """Return the published counts of the meter, each retained."""
    messages = [m for m in seen if m.topic == COUNT]
    assert not RETAIN_SHOWS or all(message.retain for message in messages)
    return [int(message.payload) for message in messages]


def test_patterns_of_presses_make_their_gestures(house: House) -> None:
    """Short though nothing changes any more, long while it is held, double at the second press."""
    with house.run() as (_, probe):
        house.press(probe, QUICK)
        probe.wait_for(lambda seen: gestures(seen) == [(QUICK, "short")])
        house.set(probe, LONG, on=True)
        probe.wait_for(lambda seen: (LONG, "long") in gestures(seen))
        house.set(probe, LONG, on=False)
        house.press(probe, PATIENT)
        house.press(probe, PATIENT)
        probe.wait_for(lambda seen: (PATIENT, "double") in gestures(seen))
        assert gestures(probe.seen) == [(QUICK, "short"), (LONG, "long"), (PATIENT, "double")]
    assert not house.file.exists()


def test_a_count_goes_on_after_a_kill(house: House) -> None:
    """No file was written, and the broker still has what was published last."""
    with house.run() as (daemon, probe):
        for _ in range(3):
            house.press(probe, METER)
        probe.wait_message(COUNT, "3")
        daemon.process.kill()
        probe.wait_message(f"{BASE}/bridge/state", "offline")  # its last will
    assert not house.file.exists()
    with house.run() as (daemon, probe):
        house.press(probe, METER)
        probe.wait_message(COUNT, "4")
        assert sorted(counts(probe.seen)) == counts(probe.seen)  # it never went back
        assert daemon.stop()[0] == 0
    assert house.kept() == 4


def test_a_reload_keeps_a_count_and_clears_what_is_not_counted(house: House) -> None:
    """A reload keeps a count, clears one that is no longer counted, and continues it later."""
    whole = house.config.read_text()
    with house.run() as (_, probe):
        house.press(probe, METER)
        probe.wait_message(COUNT, "1")
        for text, told in (
            (whole.replace("unit: L", "unit: gal"), b"2"),
            (whole.replace("count: {unit: L}", "invert: true"), b""),
            (whole, b"2"),
        ):
            probe.clear()
            house.config.write_text(text)
            probe.publish(f"{BASE}/bridge/request/reload", "{}")
            probe.wait_message(f"{BASE}/bridge/response/reload")
            probe.wait_message(f"{BASE}/garage/availability", "online")
            if "gal" in text:
                house.press(probe, METER)
            probe.wait_message(COUNT, told)


def test_what_tells_no_more_is_gone_from_home_assistant(house: House) -> None:
    """Events, triggers and the counter leave no announcement behind; the inputs stay."""
    text = house.config.read_text()
    told = [f"di_{QUICK}_event", f"di_{QUICK}_short_device_automation", f"di_{METER}_sensor"]
    with MqttProbe(house.mosquitto.port, "homeassistant/#") as other, house.run() as (_, probe):
        other.wait_for(lambda seen: all(one in announced(seen) for one in told))
        house.config.write_text(text.replace(f"inputs: {{{INPUTS}}}", "name: Garage"))
        probe.publish(f"{BASE}/bridge/request/reload", "{}")
        states = {f"di_{channel}_binary_sensor" for channel in range(1, 17)}
        other.wait_for(
            lambda seen: {one for one in announced(seen) if one.startswith("di_")} == states
        )


def announced(seen: list[Seen]) -> set[str]:
    """The components of the garage that Home Assistant would have by now."""
    latest = {m.topic: m.payload for m in seen if "/device/wisco__garage/" in m.topic}
    documents = (json.loads(payload or "{}") for payload in latest.values())
    options = (one for document in documents for one in document.get("components", {}).items())
    return {name for name, one in options if len(one) > 1}
