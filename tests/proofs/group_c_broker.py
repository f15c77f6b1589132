"""What a broker that lost its memory, or remembers too much, is told: C5."""

import time
from pathlib import Path

from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, STATIONS, is_complete, panel, retained_topics, write_config

from bridge.model import LineProtocol
from proofs.figures import Figure, Run, proof

# --- C5 ---------------------------------------------------------------------------------------

COMPLETE_WITHIN_S = 10.0


def _states(station: str) -> set[str]:
    parts = (f"{BASE}/{station}/di/", f"{BASE}/{station}/do/", f"{BASE}/{station}/problem")
    return {t for t in retained_topics() if t.startswith(parts)} | {f"{BASE}/{station}"}


def _too_early(seen: list[Seen]) -> int:
    """How many stations were wholly online before all of their states were there."""
    early = set()
    latest: dict[str, str] = {}
    for message in seen:
        latest[message.topic] = message.text
        for station in STATIONS:
            truths = ("bridge/state", "bridge/line/main/availability", f"{station}/availability")
            online = all(latest.get(f"{BASE}/{truth}") == "online" for truth in truths)
            if online and not _states(station) <= set(latest):
                early.add(station)
    return len(early)


def _is_all_there(seen: list[Seen], announced: set[str]) -> bool:
    topics = {message.topic for message in seen}
    return announced <= topics and is_complete(seen)


def _restart(mosquitto: Mosquitto, announced: set[str]) -> tuple[float, int]:
    """Restarts the broker; returns how long until all was there, and what was online too early."""
    mosquitto.restart()
    began = time.monotonic()
    with MqttProbe(mosquitto.port, f"{BASE}/#", "homeassistant/#") as probe:
        try:
            probe.wait_for(lambda seen: _is_all_there(seen, announced), COMPLETE_WITHIN_S)
        except AssertionError:
            return float("inf"), 0
        return time.monotonic() - began, _too_early(probe.seen)


def _start_and_restart(directory: Path, count: int) -> tuple[list[float], int]:
    mosquitto = Mosquitto(directory / "mosquitto")
    mosquitto.start()
    with panel(LineProtocol.WISCO) as line:
        config = write_config(directory, line, mosquitto.port)
        with MqttProbe(mosquitto.port, f"{BASE}/#", "homeassistant/#") as probe, Daemon(config):
            probe.wait_for(is_complete)
            early = _too_early(probe.seen)  # at the start the modules come up one by one
            announced = {m.topic for m in probe.seen if m.topic.endswith("/config")}
            turns = [_restart(mosquitto, announced) for _ in range(count)]
    mosquitto.stop()
    assert announced, "discovery was to be there"
    return [took_s for took_s, _ in turns], early + sum(each for _, each in turns)


@proof("C5")
def a_broker_without_memory_is_told_everything(run: Run) -> Figure:
    """States first, then that they are true; discovery as well."""
    count = run.scale.of(2, 50)
    took_s, early = _start_and_restart(run.directory, count)
    return Figure(
        injected=f"{count} restarts of a broker without persistence",
        seen=f"complete within {max(took_s):.1f} s; {early} times online before the states",
        promised=f"complete within {COMPLETE_WITHIN_S:.0f} s; 0 times",
        kept=max(took_s) <= COMPLETE_WITHIN_S and early == 0,
    )
