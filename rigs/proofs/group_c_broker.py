"""C5 and C7: a broker that lost its memory, or remembers too much."""

import signal
import time
from contextlib import nullcontext
from pathlib import Path

from support.daemon import Daemon
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, STATIONS, is_complete, panel, retained_topics, write_config

from bridge.model import LineProtocol
from proofs.figures import Figure, Run, proof

# --- C5 ---------------------------------------------------------------------------------------

COMPLETE_WITHIN_S = 10.0


def _states(station_id: str) -> set[str]:
    parts = (f"{BASE}/{station_id}/di/", f"{BASE}/{station_id}/do/", f"{BASE}/{station_id}/problem")
    return {t for t in retained_topics() if t.startswith(parts)} | {f"{BASE}/{station_id}"}


def _too_early(seen: list[Seen]) -> int:
    """Return how many stations were online before all of their states were published."""
    early = set()
    latest: dict[str, str] = {}
    for message in seen:
        latest[message.topic] = message.text
        for station_id in STATIONS:
            truths = ("bridge/state", "bridge/line/main/availability", f"{station_id}/availability")
            online = all(latest.get(f"{BASE}/{truth}") == "online" for truth in truths)
            if online and not _states(station_id) <= set(latest):
                early.add(station_id)
    return len(early)


def _after_the_last(seen: list[Seen]) -> int:
    """Return how many topics came after `bridge/state` said `online`, which must be the last."""
    texts = [(message.topic, message.text) for message in seen]
    before = {topic for topic, _ in texts[: texts.index((f"{BASE}/bridge/state", "online")) + 1]}
    return len(retained_topics() - before)


def _announced(seen: list[Seen]) -> set[str]:
    return {message.topic for message in seen if message.topic.endswith("/config")}


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
        took_s = time.monotonic() - began
        early = _too_early(probe.seen) + _after_the_last(probe.seen)
        return took_s, early


def _start_and_restart(directory: Path, count: int) -> tuple[list[float], int]:
    mosquitto = Mosquitto(directory / "mosquitto")
    mosquitto.start()
    with panel(LineProtocol.WISCO) as line:
        config = write_config(directory, line, mosquitto.port)
        with MqttProbe(mosquitto.port, f"{BASE}/#", "homeassistant/#") as probe, Daemon(config):
            probe.wait_for(lambda seen: is_complete(seen) and bool(_announced(seen)))
            early = _too_early(probe.seen)  # at the start the modules come up one by one
            announced = _announced(probe.seen)
            turns = [_restart(mosquitto, announced) for _ in range(count)]
    mosquitto.stop()
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


# --- C7 ---------------------------------------------------------------------------------------

CLEARED_WITHIN_S = 20.0
# What is another program's, however near to ours it lies, stays.
FOREIGN = {f"{BASE}/weather": "rain", "zigbee/pumps/availability": "online"}
# Without the station `pumps`, and without channel 5 of the other one.
WITHOUT_5 = "id: garage, inputs: {5: false}, outputs: {5: false}"


def _retained(port: int) -> dict[str, str]:
    """Return the retained messages."""
    with MqttProbe(port, "#") as probe:
        probe.publish("last", "")  # comes after all that was retained
        probe.wait_message("last")
        return {m.topic: m.text for m in probe.seen if m.payload and m.topic != "last"}


def _ghosts(retained: dict[str, str]) -> set[str]:
    """Topics of what is not configured any more."""
    gone = (f"{BASE}/pumps", f"{BASE}/garage/di/5", f"{BASE}/garage/do/5", "homeassistant/")
    ours = {topic for topic in retained if topic.startswith(gone)}
    marks = ("pumps", "/di/5", "/do/5", "/di_5_", "/do_5_")
    return {topic for topic in ours if any(mark in topic for mark in marks)}


def _remove(directory: Path, *, discovery: str, live: bool) -> tuple[int, int, bool]:
    """Takes modules and channels away; returns ghosts before and after, and the foreign kept."""
    directory.mkdir()
    mosquitto = Mosquitto(directory / "mosquitto")
    mosquitto.start()
    with panel(LineProtocol.MODBUS_RTU) as line:
        path = write_config(directory, line, mosquitto.port, discovery=discovery)
        with Daemon(path) as daemon:
            with MqttProbe(mosquitto.port, f"{BASE}/#") as probe:
                probe.wait_for(is_complete)
                for topic, payload in FOREIGN.items():
                    probe.publish(topic, payload, retain=True)
            before = len(_ghosts(_retained(mosquitto.port)))
            text = path.read_text().replace("id: garage", WITHOUT_5)
            path.write_text("".join(x for x in text.splitlines(True) if "id: pumps" not in x))
            if live:
                daemon.signal(signal.SIGHUP)
            else:
                daemon.stop()
            with nullcontext() if live else Daemon(path):
                after, kept = _when_cleared(mosquitto.port)
    mosquitto.stop()
    return before, after, kept


def _when_cleared(port: int) -> tuple[int, bool]:
    until = time.monotonic() + CLEARED_WITHIN_S
    while _ghosts(_retained(port)) and time.monotonic() < until:
        time.sleep(0.2)  # a broker tells nobody that it forgot: it is asked again
    retained = _retained(port)
    return len(_ghosts(retained)), retained.items() >= FOREIGN.items()


@proof("C7")
def what_is_not_configured_leaves_no_ghosts(run: Run) -> Figure:
    """A module and channels are taken out of the configuration: the broker forgets them."""
    ways = [(form, live) for form in ("device", "single") for live in (True, False)]
    ways = ways[: run.scale.of(1, len(ways))]
    turns = [
        _remove(run.directory / f"{form}-{live}", discovery=form, live=live) for form, live in ways
    ]
    before, after = sum(turn[0] for turn in turns), sum(turn[1] for turn in turns)
    kept = all(turn[2] for turn in turns)
    return Figure(
        injected=f"a module and 2 channels removed in {len(ways)} ways, {before} retained topics",
        seen=f"{after} left; topics of others {'kept' if kept else 'lost'}",
        promised="0 left, topics of others kept",
        kept=before > 0 and after == 0 and kept,
    )
