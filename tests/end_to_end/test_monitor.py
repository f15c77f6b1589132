"""A bridge at work, listened to, and its line played back to another bridge."""

import json
import shutil
import subprocess
from collections import defaultdict
from functools import partial
from pathlib import Path

import pytest
from support.daemon import Daemon
from support.monitor import Monitor
from support.mqtt_probe import MqttProbe, Seen
from support.panel import BASE, broker, is_complete, results, write_config
from support.tapped_line import tapped_line

from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator import SimulatedLine, SimulatedModule
from bridge.simulator.recording import Recording
from bridge.transcript import load_transcript

BAUD = 9600
ROUNDS = 8
# A busy machine answers late, and the first record is without a lost reply.
KEYS = "    timeout: 2s\n    output_sweep: 0s\n"
FURTHER = 40  # frames: several rounds of polls


def live(line: SimulatedLine, probe: MqttProbe) -> None:
    """Inputs that change, outputs that are switched."""
    for number in range(1, ROUNDS + 1):
        line.module(1).toggle_input(number)
        probe.wait_message(f"{BASE}/garage/di/{number}", "ON")
        probe.publish(f"{BASE}/pumps/do/{number}/set", json.dumps({"state": "ON", "id": number}))
        probe.wait_for(partial(_answered, number))


def _answered(number: int, seen: list[Seen]) -> bool:
    return any(verdict.get("id") == number for verdict in results(seen))


def polled_alike(config: Path) -> Path:
    """Has outputs read as often as inputs, so that polls see what commands did."""
    text = config.read_text()
    config.write_text(text.replace("    stations:", f"{KEYS}    stations:"))
    return config


def states(seen: list[Seen]) -> dict[str, list[str]]:
    """Return the published values of each channel, in order."""
    history: dict[str, list[str]] = defaultdict(list)
    for message in seen:
        if message.topic.split("/")[-2] in {"di", "do"}:
            history[message.topic].append(message.text)
    return dict(history)


@pytest.mark.parametrize("protocol", [LineProtocol.WISCO, LineProtocol.MODBUS_RTU])
def test_a_record_gives_another_bridge_the_same_states(
    protocol: LineProtocol, tmp_path: Path
) -> None:
    """A replayed record gives the same states in the same order; Wireshark reads its frames."""
    capture = tmp_path / "record.pcapng"
    modules = (SimulatedModule(DIO100, 1), SimulatedModule(DO100, 2))
    with (
        broker(tmp_path) as mosquitto,
        tapped_line(tmp_path, protocol, *modules, baud=BAUD) as line,
        Monitor(tmp_path, "--quiet", "--record", str(capture), baud=BAUD) as monitor,
    ):
        config = polled_alike(write_config(tmp_path, line, mosquitto.port))
        with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config) as daemon:
            probe.wait_for(is_complete)
            live(line, probe)
            # The replay's bridge sends no commands: it sees what polls saw, after the last one too.
            enough = monitor.entries() + FURTHER
            monitor.wait_until(lambda: monitor.entries() >= enough)
            assert daemon.stop()[0] == 0
            recorded = states(probe.seen)
        counts = monitor.end()
    transcript = load_transcript(monitor.record)
    print(f"{protocol}: {len(transcript.entries)} frames\n{counts}")
    assert [row.split()[4:6] for row in counts.splitlines()[1:]] == [["0", "0"], ["0", "0"]]
    if protocol is LineProtocol.MODBUS_RTU and shutil.which("tshark"):
        assert decoded_as_modbus(capture) == len(transcript.entries)

    assert transcript.protocol is not None
    replay = SimulatedLine(transcript.protocol, BAUD, [], recording=Recording(transcript.entries))
    (tmp_path / "again").mkdir()
    with replay, broker(tmp_path / "again") as mosquitto:
        config = polled_alike(write_config(tmp_path / "again", replay, mosquitto.port))
        with MqttProbe(mosquitto.port, f"{BASE}/#") as probe, Daemon(config):
            probe.wait_for(lambda seen: is_complete(seen) and states(seen) == recorded)


def decoded_as_modbus(capture: Path) -> int:
    """Return the packets that tshark reads as Modbus RTU with the right CRC: it must be all."""
    rows = subprocess.run(
        ["tshark", "-r", str(capture), "-d", "rtacser.data,mbrtu",
         "-o", "mbrtu.crc_verification:TRUE",
         "-T", "fields", "-e", "_ws.col.Protocol", "-e", "mbrtu.crc16.status"],
        check=True, capture_output=True, text=True, timeout=60,
    ).stdout.splitlines()  # fmt: skip
    assert set(rows) == {"Modbus RTU\t1"}
    return len(rows)
