"""The EEPROM over the wire: all of it read, only what differs written, and resumed."""

import random
import re
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.commission_line import STATION, line_of_one
from support.panel_bus import bus_on

from bridge.commission.eeprom import PAGE_BYTES, Eeprom, NotRestoredError, patches_for
from bridge.errors import NoReplyError, PortError, RefusedError
from bridge.model import LineProtocol
from bridge.simulator import FaultKind, SimulatedLine, SimulatedModule, is_write
from bridge.simulator.wire import Direction

EEPROM_BYTES = 2048
_WEE = re.compile(rb"#0DWEE0....(..)")


@pytest.fixture
def line() -> Iterator[SimulatedLine]:
    """One DIO100 on a line that takes no time."""
    with line_of_one(LineProtocol.WISCO) as line:
        yield line


def contents(line: SimulatedLine) -> bytes:
    """Return the EEPROM of the module."""
    return line.module(STATION).read_eeprom(0, EEPROM_BYTES)


def written_bytes(line: SimulatedLine) -> int:
    """Return the number of bytes in the WEE frames on the wire."""
    frames = [entry.data for entry in line.log if entry.direction is Direction.TO_MODULES]
    return sum(int(found[1], 16) for frame in frames if (found := _WEE.match(frame)))


def read(line: SimulatedLine, timeout_s: float = 2.0) -> bytes:
    """Return the result of a dump."""
    with bus_on(line, timeout_s) as bus:
        return Eeprom(bus, STATION).read(lambda _done, _of: None)


def restore(line: SimulatedLine, wanted: bytes, timeout_s: float = 2.0) -> int:
    """Brings the module to `wanted`; returns how many bytes differed."""
    with bus_on(line, timeout_s) as bus:
        eeprom = Eeprom(bus, STATION)
        now = eeprom.read(lambda _done, _of: None)
        patches = patches_for(now, dict(enumerate(wanted)))
        eeprom.write(patches, lambda _done, _of: None)
    return sum(len(patch.data) for patch in patches)


def changed(data: bytes, count: int, seed: int) -> bytes:
    """The same with `count` bytes different, some side by side."""
    chance = random.Random(seed)  # noqa: S311 - test data, not secrets
    result = bytearray(data)
    for address in chance.sample(range(len(data)), count):
        result[address] ^= chance.randrange(1, 256)
    return bytes(result)


# --- what is to be written ---


@given(st.binary(min_size=64, max_size=64), st.binary(min_size=64, max_size=64))
def test_patches_turn_the_one_into_the_other(now: bytes, wanted: bytes) -> None:
    """Patches hold each differing byte once, no equal byte, and do not cross a page."""
    patches = patches_for(now, dict(enumerate(wanted)))
    result = bytearray(now)
    for patch in patches:
        end = patch.address + len(patch.data)
        assert patch.address // PAGE_BYTES == (end - 1) // PAGE_BYTES
        result[patch.address : end] = patch.data
    assert bytes(result) == wanted
    differing = sum(a != b for a, b in zip(now, wanted, strict=True))
    assert sum(len(patch.data) for patch in patches) == differing


def test_neighbours_go_together() -> None:
    """Sixteen bytes of a page that all differ are one write."""
    patches = patches_for(bytes(64), dict.fromkeys(range(64), 1))
    assert [(patch.address, len(patch.data)) for patch in patches] == [
        (0, 16), (16, 16), (32, 16), (48, 16)
    ]  # fmt: skip


def test_addresses_that_an_image_leaves_out_stay() -> None:
    """A part of an image writes that part."""
    assert [patch.data for patch in patches_for(bytes(2048), {5: 0, 7: 9})] == [b"\x09"]


# --- on the wire ---


def test_all_of_it_is_read(line: SimulatedLine) -> None:
    """2,048 bytes in several blocks, as they are."""
    wanted = changed(contents(line), 2048, seed=1)
    line.module(STATION).write_eeprom(0, wanted)
    assert read(line) == wanted


def test_a_restore_writes_what_differs_and_no_byte_more(line: SimulatedLine) -> None:
    """Bytes written are bytes that differ, and afterwards all 2,048 are as wanted."""
    wanted = changed(contents(line), 300, seed=2)
    assert restore(line, wanted) == 300
    assert contents(line) == wanted
    assert written_bytes(line) == 300


def test_nothing_is_written_where_nothing_differs(line: SimulatedLine) -> None:
    """The EEPROM does not wear out by being looked at."""
    assert restore(line, contents(line)) == 0
    assert line.module(STATION).eeprom_writes == 0


def test_a_hang_up_in_the_middle_is_resumed(line: SimulatedLine) -> None:
    """The second run writes the rest, and both together each differing byte once."""
    before = contents(line)
    wanted = changed(before, 300, seed=3)
    line.faults.set(FaultKind.HANG_UP, times=1, delay_s=0.1, only=_after_writes(60))
    with pytest.raises(PortError):
        restore(line, wanted)
    first = written_bytes(line)
    left = sum(a != b for a, b in zip(contents(line), wanted, strict=True))
    assert 0 < left < 300
    line.restore()
    assert restore(line, wanted) == left
    assert contents(line) == wanted
    # The frame that the hang-up struck was heard on the wire and not obeyed: it is sent again.
    lost = first - (300 - left)
    assert 0 < lost <= PAGE_BYTES
    assert written_bytes(line) == 300 + lost


def test_lost_and_damaged_replies_write_no_byte_twice(line: SimulatedLine) -> None:
    """After a lost acknowledgement the bytes are read, and not written a second time."""
    wanted = changed(contents(line), 40, seed=4)
    line.faults.set(FaultKind.SILENT, times=3, only=is_write)
    assert restore(line, wanted, timeout_s=0.3) == 40
    assert contents(line) == wanted
    assert written_bytes(line) == 40


def test_a_read_that_was_damaged_is_repeated(line: SimulatedLine) -> None:
    """A flipped bit is found by the checksum, or by the form."""
    line.faults.set(FaultKind.FLIP, times=2)
    assert read(line, timeout_s=0.5) == contents(line)


def test_a_module_that_is_away_is_no_reply(line: SimulatedLine) -> None:
    """A module that is away is asked a few times, then NoReplyError is raised."""
    line.module(STATION).away = True
    with bus_on(line, timeout_s=0.05) as bus, pytest.raises(NoReplyError, match="station 13"):
        Eeprom(bus, STATION).read(lambda _done, _of: None)


def test_a_refusal_ends_it(line: SimulatedLine) -> None:
    """A module that says no is not asked again."""
    line.faults.set(FaultKind.REFUSE, only=is_write)
    with pytest.raises(RefusedError):
        restore(line, changed(contents(line), 5, seed=5))


def test_a_worn_out_cell_is_found(line: SimulatedLine, monkeypatch: pytest.MonkeyPatch) -> None:
    """A module that confirms and does not hold is told apart from success."""
    monkeypatch.setattr(SimulatedModule, "write_eeprom", lambda *_: None)
    with pytest.raises(
        NotRestoredError, match=r"station 13 holds ff at 0005h after 00 was written"
    ):
        restore(line, b"\xff" * 5 + b"\x00" + contents(line)[6:])


def _after_writes(count: int) -> Callable[[bytes], bool]:
    seen = 0

    def only(frame: bytes) -> bool:
        nonlocal seen
        seen += is_write(frame)
        return is_write(frame) and seen > count

    return only


def test_a_write_that_never_arrives_is_no_reply(line: SimulatedLine) -> None:
    """A write that never arrives is tried three times, each time after a read."""
    line.faults.set(FaultKind.DEAF, only=is_write)
    with pytest.raises(NoReplyError):
        restore(line, changed(contents(line), 1, seed=6), timeout_s=0.1)
    assert written_bytes(line) == 3
    assert line.module(STATION).eeprom_writes == 0
