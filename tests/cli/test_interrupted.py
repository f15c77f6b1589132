"""Commands that have an end, interrupted before it: status 130, and one line that says how far."""

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from support.mosquitto import Mosquitto
from support.mqtt_probe import MqttProbe
from support.one_panel import GARAGE, one_panel

from bridge.commission.cabinet import Cabinet, KeptModule, write_cabinet
from bridge.commission.image import ImageFormat, image_text, write_image
from bridge.model import DIO100
from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.wire import Direction

BOTH = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
PATIENCE_S = 20.0


def interrupted(
    directory: Path, number: int, words: str, *, after: int, of: Callable[[bytes], bool]
) -> tuple[str, int]:
    """Runs `words` until no answer comes `after` so many frames `of` a kind, and stops it there.

    Gives what it said on stderr, and how many bytes its module's EEPROM took.
    """
    with one_panel(directory) as (line, config):
        count = iter(range(10_000))
        line.faults.set(FaultKind.SILENT, only=lambda frame: of(frame) and next(count) >= after)

        def asked() -> int:
            frames = (e.data for e in line.log if e.direction is Direction.TO_MODULES)
            return sum(map(of, frames))

        command = [sys.executable, "-m", "bridge", "-c", str(config), *words.split()]
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
            deadline = time.monotonic() + PATIENCE_S
            while asked() <= after:
                assert time.monotonic() < deadline
                assert process.poll() is None
                time.sleep(0.01)
            process.send_signal(number)
            _, err = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 130, err
        return err, line.module(GARAGE).eeprom_writes


def reads_eeprom(frame: bytes) -> bool:
    """REE."""
    return frame[3:6] == b"REE"


@BOTH
def test_a_dump_says_how_far_it_came(number: int, tmp_path: Path) -> None:
    """No file is there, nor half of one, nor anything in its place."""
    path = tmp_path / "garage.hex"
    words = f"eeprom dump garage {path}"
    err, _ = interrupted(tmp_path, number, words, after=3, of=reads_eeprom)
    told = f"interrupted: 384 of 2048 bytes of garage are read: {path} is not written"
    assert err == f"wisco2mqtt: {told}\n"
    assert [one.name for one in tmp_path.iterdir()] == ["config.yaml"]


def test_a_restore_says_what_is_written(tmp_path: Path) -> None:
    """An interrupted restore reports what was read back, and that it can be continued."""
    path = tmp_path / "garage.hex"
    write_image(path, ImageFormat.HEX, bytes(2048), DIO100)
    words = f"eeprom restore garage {path} --yes"
    err, _ = interrupted(tmp_path, signal.SIGTERM, words, after=4, of=is_write)
    told = rf"64 of \d+ bytes of garage are written: restore {path} again, and it goes on from"
    assert re.search(told, err.splitlines()[-1]), err


def test_a_restore_that_has_only_read_says_so(tmp_path: Path) -> None:
    """The module is as it was."""
    path = tmp_path / "garage.hex"
    write_image(path, ImageFormat.HEX, bytes(2048), DIO100)
    words = f"eeprom restore garage {path} --yes"
    err, writes = interrupted(tmp_path, signal.SIGINT, words, after=2, of=reads_eeprom)
    assert err.endswith("are read: nothing is written to the module\n")
    assert writes == 0


def test_settings_say_how_much_is_written(tmp_path: Path) -> None:
    """`apply` once more writes the rest."""
    path = tmp_path / "garage.yaml"
    holds = ", ".join(f"{n}: {{hold: 2.{n}s}}" for n in range(1, 9))
    path.write_text(f"model: DIO100\noutputs: {{{holds}}}\n")
    words = f"settings apply garage {path} --yes"
    err, _ = interrupted(tmp_path, signal.SIGTERM, words, after=2, of=is_write)
    assert err == (
        "wisco2mqtt: interrupted: 2 registers are written to garage: apply does the rest\n"
    )


def test_get_says_that_it_was_not_done(tmp_path: Path) -> None:
    """An interrupted `get` only reports that it was not done."""
    err, _ = interrupted(tmp_path, signal.SIGTERM, "get garage", after=1, of=bool)
    assert err == "wisco2mqtt get: interrupted before it was done\n"


@BOTH
def test_send_says_that_it_was_sent(number: int, mosquitto: Mosquitto, tmp_path: Path) -> None:
    """No bridge is there, so no verdict comes."""
    config = tmp_path / "config.yaml"
    config.write_text(
        f"mqtt: {{host: 127.0.0.1, port: {mosquitto.port}}}\n"
        "lines: [{id: main, port: /dev/null, baud: 9600, protocol: wisco,\n"
        "         stations: [{address: 1, model: DIO100, id: garage}]}]\n"
    )
    command = [sys.executable, "-m", "bridge", "-c", str(config), "send", "garage", "do/3", "ON"]
    with (
        MqttProbe(mosquitto.port, "wisco/#") as probe,
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process,
    ):
        probe.wait_message("wisco/garage/do/3/set")
        process.send_signal(number)
        _, err = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 130
    told = "garage do/3 ON was sent, and what became of it is not known"
    assert err == f"wisco2mqtt: interrupted: {told}\n"


def test_a_backup_says_that_there_is_none(tmp_path: Path) -> None:
    """Neither the file nor a part of it."""
    path = tmp_path / "cabinet.zip"
    err, writes = interrupted(tmp_path, signal.SIGINT, f"backup {path}", after=3, of=reads_eeprom)
    assert err == (
        f"wisco2mqtt: interrupted: 384 of 2048 bytes of garage are read: {path} is not written\n"
    )
    assert (writes, path.exists()) == (0, False)


def test_a_restored_cabinet_says_what_is_written(tmp_path: Path) -> None:
    """The same command goes on from there."""
    path = tmp_path / "cabinet.zip"
    image = image_text(bytes(2048), DIO100)
    kept = KeptModule("garage", DIO100, None, image)
    write_cabinet(path, Cabinet("2026-11-27", "0.1.0", b"lines: []\n", None, (kept,)))
    words = f"restore {path} garage --yes"
    err, _ = interrupted(tmp_path, signal.SIGTERM, words, after=4, of=is_write)
    told = rf"64 of \d+ bytes of garage are written: restore {path} again, and it goes on from"
    assert re.search(told, err.splitlines()[-1]), err
