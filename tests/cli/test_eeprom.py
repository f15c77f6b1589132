"""`wisco2mqtt eeprom`: dump, diff, restore; only what differs is written, and it can be resumed."""

import json
import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.commission_line import STATION, Laptop, config_of, line_of_one

from bridge.cli import main as cli
from bridge.commission.image import ImageFormat, read_image, write_image
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator import FaultKind, is_write
from bridge.simulator.wire import Direction

EEPROM_BYTES = 2048
PART = ":0100000012ED\n:00000001FF\n"
_WEE = re.compile(rb"#0DWEE0....(..)")


@pytest.fixture
def laptop(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Laptop]:
    """On a Wisco line."""
    monkeypatch.setattr(cli, "configure_logging", lambda *_: None)
    with line_of_one(LineProtocol.WISCO) as line:
        yield Laptop(capsys, line, config_of(tmp_path, line))


def contents(laptop: Laptop) -> bytes:
    """Return the EEPROM of the module."""
    return laptop.line.module(STATION).read_eeprom(0, EEPROM_BYTES)


def sent_bytes(laptop: Laptop) -> int:
    """Return the number of bytes in the WEE frames on the wire."""
    entries = (e.data for e in laptop.line.log if e.direction is Direction.TO_MODULES)
    return sum(int(found[1], 16) for data in entries if (found := _WEE.match(data)))


def changed_copy(path: Path, image_format: ImageFormat, count: int) -> bytes:
    """Changes `count` bytes of an image file, and returns what it is now."""
    chance = random.Random(7)  # noqa: S311 - test data, not secrets
    data = bytearray(read_image(path, image_format).content.values())
    for address in chance.sample(range(EEPROM_BYTES), count):
        data[address] ^= chance.randrange(1, 256)
    write_image(path, image_format, bytes(data), DIO100)
    return bytes(data)


@pytest.mark.parametrize("image_format", ImageFormat)
def test_dump_change_diff_restore_verify(
    laptop: Laptop, image_format: ImageFormat, tmp_path: Path
) -> None:
    """All 2,048 bytes there and back; bytes written are bytes that differ."""
    path = tmp_path / f"garage.{image_format}"
    assert laptop.on_station("eeprom", "dump", str(path)).status == 0
    assert bytes(read_image(path, image_format).content.values()) == contents(laptop)
    assert laptop.on_station("eeprom", "diff", str(path)).status == 0
    wanted = changed_copy(path, image_format, 200)
    differing = laptop.on_station("eeprom", "diff", str(path))
    assert differing.status == 1
    assert "200 of 2048 bytes differ" in differing.err
    shown = [row.split(" -> ")[1].split() for row in differing.out.splitlines()]
    assert sum(map(len, shown)) == 200
    origin = () if image_format is ImageFormat.HEX else ("--from", "DIO100")
    done = laptop.on_station("eeprom", "restore", str(path), "--yes", *origin)
    assert (done.status, done.out) == (0, "")
    assert "all 2048 bytes were read back" in done.err
    assert contents(laptop) == wanted
    assert sent_bytes(laptop) == 200
    again = laptop.on_station("eeprom", "restore", str(path), "--yes", *origin)
    assert (again.status, "nothing differs" in again.err) == (0, True)
    assert sent_bytes(laptop) == 200


def test_each_action_tells_one_object_as_json(laptop: Laptop, tmp_path: Path) -> None:
    """A program reads it: what was dumped, what differs and where, how much was written."""
    path = tmp_path / "garage.hex"

    def told(action: str, *more: str) -> Any:
        return json.loads(laptop.on_station("eeprom", action, str(path), "--json", *more).out)

    assert told("dump") == {"file": str(path), "model": "DIO100", "bytes": EEPROM_BYTES}
    assert told("diff") == {"differing": 0, "of": EEPROM_BYTES, "patches": []}
    before = contents(laptop)
    wanted = changed_copy(path, ImageFormat.HEX, 20)
    differing = told("diff")
    assert (differing["differing"], differing["of"]) == (20, EEPROM_BYTES)
    for patch in differing["patches"]:
        end = patch["address"] + len(patch["file"]) // 2
        assert bytes.fromhex(patch["file"]) == wanted[patch["address"] : end]
        assert bytes.fromhex(patch["module"]) == before[patch["address"] : end]
    assert told("restore", "--yes") == {"file": str(path), "differing": 20, "written": 20}
    assert told("restore", "--yes") == {"file": str(path), "differing": 0, "written": 0}


def test_a_restore_that_a_hang_up_ended_goes_on(laptop: Laptop, tmp_path: Path) -> None:
    """The complaint says how far it came; the same command does the rest."""
    path = tmp_path / "garage.hex"
    laptop.on_station("eeprom", "dump", str(path))
    wanted = changed_copy(path, ImageFormat.HEX, 200)
    writes = iter(range(1000))
    laptop.line.faults.set(
        FaultKind.HANG_UP, times=1, only=lambda frame: is_write(frame) and next(writes) == 50
    )
    broken = laptop.on_station("eeprom", "restore", str(path), "--yes")
    assert broken.status == 1
    told = re.search(r"(\d+) of 200 bytes are written and read back", broken.err)
    assert told
    laptop.line.restore()
    left = sum(a != b for a, b in zip(contents(laptop), wanted, strict=True))
    assert left == 200 - int(told[1])
    assert 0 < left < 200
    rest = laptop.on_station("eeprom", "restore", str(path), "--yes")
    assert f"{left} of 2048 bytes differ" in rest.err
    assert rest.status == 0
    assert contents(laptop) == wanted


def test_a_restore_asks_first(laptop: Laptop, tmp_path: Path) -> None:
    """Without a terminal to ask at, a restore needs --yes."""
    path = tmp_path / "part.hex"
    path.write_text(PART)
    done = laptop.on_station("eeprom", "restore", str(path), "--from", "DIO100")
    assert (done.status, "add --yes" in done.err) == (2, True)
    assert "1 of 1 bytes differ" in done.err
    assert laptop.line.module(STATION).eeprom_writes == 0


def test_a_dump_replaces_nothing_unless_told(laptop: Laptop, tmp_path: Path) -> None:
    """A backup of yesterday is worth more than one of today."""
    path = tmp_path / "garage.bin"
    path.write_bytes(b"precious")
    done = laptop.on_station("eeprom", "dump", str(path))
    assert (done.status, "--force replaces it" in done.complaint) == (1, True)
    assert path.read_bytes() == b"precious"
    assert laptop.on_station("eeprom", "dump", str(path), "--force").status == 0
    assert path.read_bytes() == contents(laptop)


@pytest.mark.parametrize("action", ["diff", "restore"])
def test_a_file_that_is_no_image_is_told_before_anybody_is_asked(
    laptop: Laptop, action: str, tmp_path: Path
) -> None:
    """With its line, and exit status 1."""
    path = tmp_path / "garage.hex"
    path.write_text(":0100000012EE\n:00000001FF\n")
    done = laptop.on_station("eeprom", action, str(path))
    assert (done.status, "line 1: checksum EE" in done.complaint) == (1, True)
    assert laptop.line.log == ()


def test_what_does_not_say_its_model_is_asked_for_it(laptop: Laptop, tmp_path: Path) -> None:
    """Raw bytes never say it, nor does Intel HEX of other tools: --from does."""
    path = tmp_path / "part.hex"
    path.write_text(PART)
    asked = laptop.on_station("eeprom", "restore", str(path), "--yes")
    told = "does not say which model it was read from: add --from DIO100 or --from DO100"
    assert (asked.status, told in asked.complaint) == (2, True)
    other = laptop.on_station("eeprom", "restore", str(path), "--yes", "--from", "DO100")
    told = f"{path} is the EEPROM of a DO100, and garage is a DIO100: nothing is written"
    assert (other.status, told in other.complaint) == (1, True)
    assert laptop.line.module(STATION).eeprom_writes == 0
    assert laptop.on_station("eeprom", "restore", str(path), "--yes", "--force").status == 0
    assert contents(laptop)[0] == 0x12


def test_an_image_of_the_other_model_is_refused(laptop: Laptop, tmp_path: Path) -> None:
    """A dump as Intel HEX says itself whose it is; --from cannot say otherwise."""
    path = tmp_path / "pumps.hex"
    write_image(path, ImageFormat.HEX, bytes(EEPROM_BYTES), DO100)
    done = laptop.on_station("eeprom", "restore", str(path), "--yes")
    assert (done.status, "is the EEPROM of a DO100" in done.complaint) == (1, True)
    done = laptop.on_station("eeprom", "restore", str(path), "--yes", "--from", "DIO100")
    assert (done.status, "says itself that it is of a DO100" in done.complaint) == (2, True)
    assert laptop.line.module(STATION).eeprom_writes == 0
    compared = laptop.on_station("eeprom", "diff", str(path))
    assert "is the EEPROM of a DO100, and garage is a DIO100" in compared.err
    assert compared.status == 1


@pytest.mark.parametrize("action", ["diff", "restore"])
def test_a_raw_file_that_is_cut_off_is_no_image(
    laptop: Laptop, action: str, tmp_path: Path
) -> None:
    """A raw file that is too short is refused, because its end would count as equal."""
    path = tmp_path / "garage.bin"
    path.write_bytes(contents(laptop)[:100])
    done = laptop.on_station("eeprom", action, str(path), "--yes", "--from", "DIO100")
    assert (done.status, "it has 100 bytes, and a whole EEPROM 2048" in done.complaint) == (1, True)
    assert laptop.line.log == ()
