"""`make scans`: the scan of a panel of which nothing is known, in full and in real time.

Twelve modules of both models at odd addresses, 19200 baud, protocol unknown: a thorough scan over
all stations, baud rates and protocols, then `check` and `run` with what it wrote. Minutes each.
"""

import json
import random
from pathlib import Path

import pytest
from support.daemon import Daemon
from support.panel import broker

from bridge.cli.main import main
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from bridge.simulator.wire import Direction

pytestmark = pytest.mark.timeout(600)

TWELVE = {address: (DIO100, DO100)[address % 4 // 2] for address in range(1, 24, 2)}


@pytest.fixture(autouse=True)
def _leave_logging_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridge.cli.main.configure_logging", lambda *_: None)


@pytest.mark.parametrize("protocol", [LineProtocol.WISCO, LineProtocol.MODBUS_RTU])
@pytest.mark.parametrize("trouble", [None, FaultKind.SILENT, FaultKind.ECHO])
def test_a_thorough_scan_finds_all_twelve_and_what_it_writes_runs(
    protocol: LineProtocol,
    trouble: FaultKind | None,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A thorough scan finds all twelve, also with lost replies or an echo, and writes nothing."""
    path = tmp_path / "config.yaml"
    modules = [SimulatedModule(model, address) for address, model in TWELVE.items()]
    with SimulatedLine(protocol, 19200, modules, chance=random.Random(1)) as line:  # noqa: S311 - damage, not secrets
        if trouble is not None:
            probability = 0.05 if trouble is FaultKind.SILENT else 1.0
            line.faults.set(trouble, probability=probability)
        status = main(["scan", line.port, "--thorough", "--json", "--write", str(path)])
        document = json.loads(capsys.readouterr().out)
        sent = [entry.data for entry in line.log if entry.direction is Direction.TO_MODULES]
        assert len(sent) > 1000
        assert not [frame for frame in sent if is_write(frame)]
        assert {one["address"]: one["model"] for one in document["found"]} == {
            address: model.name for address, model in TWELVE.items()
        }
        assert (len(document["found"]), document["clashes"], status) == (12, [], 0)
        seconds, least = document["seconds"], document["least_seconds"]
        with capsys.disabled():
            words = f"{protocol}, {trouble or 'no trouble'}"
            print(f"\n{words}: {len(sent)} frames, {seconds:.1f} s, the least is {least:.1f} s")
        assert seconds < 1.2 * least
        assert main(["-c", str(path), "check"]) == 0
        _run(path, tmp_path)


def _run(path: Path, directory: Path) -> None:
    """The daemon meets every module of the file, with nothing but a broker's port put in."""
    with broker(directory) as mosquitto:
        at_broker = f"  port: {mosquitto.port}\n  host: 127.0.0.1"
        text = path.read_text().replace("  host: localhost", at_broker, 1)
        path.write_text(f"{text}state_dir: {directory}\n")
        with Daemon(path) as daemon:
            for address, model in TWELVE.items():
                daemon.wait_for_log(f"(main_{address:02}): online: {model.name}")
            assert daemon.stop()[0] == 0
