"""Warnings about unsolicited bytes, by rule and on a line."""

import logging
from dataclasses import replace

import pytest
from support.bus_worker import BusWorker
from support.virtual_worker import make_line, make_station

from bridge.line.rules.strays import CONTESTED_S, REMIND_S, StrayWatch, is_text
from bridge.model import DO100, LineMeasured, LineProtocol

T = 103.0
FRAMES = {
    LineProtocol.WISCO: b"#0ARDOH\r",
    LineProtocol.MODBUS_RTU: bytes.fromhex("09 02 00 00 00 10 78 4E"),
    LineProtocol.MODBUS_ASCII: b":090200000010E5\r\n",
}


class Warnings:
    """A watch, and what it warned of."""

    def __init__(self) -> None:
        self.told: list[tuple[int, bytes]] = []
        self.watch = StrayWatch(lambda count, evidence: self.told.append((count, evidence)))

    def hear(self, *pieces: tuple[float, int]) -> None:
        """Bytes at these instants."""
        for instant, count in pieces:
            self.watch.heard(count, b"x" * count, instant)


def test_a_frame_is_told_at_once() -> None:
    """A foreign frame is reported at once, with number and content of its bytes."""
    warnings = Warnings()
    warnings.hear((100.0, 8))
    assert warnings.told == [(8, b"x" * 8)]


def test_a_frame_in_pieces_is_told() -> None:
    """Our own exchanges cut into what the other master says."""
    warnings = Warnings()
    warnings.hear((100.0, 3), (102.0, 4))
    assert warnings.told == [(7, b"xxxx")]


def test_a_byte_or_two_are_never_told() -> None:
    """Adapters that switch direction make them, however often."""
    warnings = Warnings()
    warnings.hear(*[(100.0 + n * 0.02, 1 + n % 2) for n in range(5000)])
    assert warnings.told == []


def test_pieces_that_lie_far_apart_make_no_frame() -> None:
    """A short piece once in a while is noise."""
    warnings = Warnings()
    warnings.hear(*[(100.0 + n * 6, 4) for n in range(100)])
    assert warnings.told == []


def test_what_goes_on_is_told_again_after_ten_minutes() -> None:
    """One line for as long, and the reminder counts what came meanwhile."""
    warnings = Warnings()
    warnings.hear(*[(100.0 + n, 8) for n in range(1500)])
    counts = [count for count, _ in warnings.told]
    assert counts == [8, 8 * REMIND_S, 8 * REMIND_S]


def test_what_came_long_ago_is_not_told_with_the_next() -> None:
    """A new beginning counts anew."""
    warnings = Warnings()
    warnings.hear((100.0, 8), (101.0, 8), (5000.0, 4))
    assert len(warnings.told) == 1
    warnings.hear((5001.0, 4))
    assert warnings.told[1][0] == 8


def test_text_of_a_gateway_contests_no_reply() -> None:
    """Text of a gateway contests no reply; bytes of frames do, and without a gateway all do."""
    for gateway, heard, contested in (
        (True, b"USR-TCP232-T2", False),
        (True, b"DI>0000\r", True),
        (False, b"USR-TCP232-T2", True),
    ):
        watch = StrayWatch(lambda *_: None, gateway=gateway)
        watch.heard(len(heard), heard, 100.0)
        assert watch.is_contested(100.0) is contested
        assert not watch.is_contested(100.0 + CONTESTED_S)


@pytest.mark.parametrize(
    ("heard", "text"),
    [
        (b"USR-TCP232-T2", True),
        (b"heartbeat\r\n", True),
        (b"www.usr.cn", True),
        (b"D8:B0:4C:AA:BB:01", True),
        (b"d8-b0-4c-aa-bb-01\r\n", True),
        (b"D8B04CAABB01", False),  # may be the end of a frame
        (b"DI>9EAB\r", False),
        (b"9EAB\rDO>D2\r", False),
        (b"ERR=1\r", False),
        (b"USR-TCP232DI>9EA", False),
        (b"#01RDIH\r", False),
        (b"DO>OK\r", False),
        (b":0302020000F9\r\n", False),
        (b"#13WDOX73,72\r", False),
        (bytes.fromhex("09 02 00 00 00 10 78 4E"), False),
        (b"\r\n", False),
    ],
)
def test_text_is_no_piece_of_a_frame(heard: bytes, *, text: bool) -> None:
    """Registration and heartbeat packets, and hardware addresses."""
    assert is_text(heard) is text


# --- on a line ------------------------------------------------------------------------------------


def line_of(protocol: LineProtocol) -> BusWorker:
    """A DIO100 and a DO100 on the real bus."""
    return BusWorker(make_line(make_station(1), make_station(2, DO100), protocol=protocol))


def foreign_frame_every(worker: BusWorker, frame: bytes, seconds: float, until: float) -> None:
    """Another master speaks on the line."""

    def speak() -> None:
        worker.bus_line.foreign += frame
        if worker.line.now + seconds < until:
            worker.line.at(worker.line.now + seconds, speak)

    worker.line.at(T, speak)


def warnings_of(caplog: pytest.LogCaptureFixture) -> list[str]:
    """The warnings of the line."""
    texts = [record.getMessage() for record in caplog.records]
    return [text for text in texts if "not requested" in text]


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_another_master_is_told_within_5_s(
    protocol: LineProtocol, caplog: pytest.LogCaptureFixture
) -> None:
    """Another master on a busy line is reported within 5 s, with line, number and evidence."""
    worker = line_of(protocol)
    foreign_frame_every(worker, FRAMES[protocol], 0.5, T + 5)
    with caplog.at_level(logging.WARNING):
        worker.run(T + 5)
    (warning,) = warnings_of(caplog)
    assert warning.startswith("line main: ")
    assert "another master on this line?" in warning
    assert FRAMES[protocol][:3].hex(" ") in warning
    assert {getattr(record, "line", None) for record in caplog.records} == {"main"}


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_it_is_told_too_where_no_module_answers(
    protocol: LineProtocol, caplog: pytest.LogCaptureFixture
) -> None:
    """The line is listened to while nothing is asked."""
    worker = line_of(protocol)
    for module in worker.line.modules.values():
        module.away = True
    foreign_frame_every(worker, FRAMES[protocol], 1.0, T + 5)
    with caplog.at_level(logging.WARNING):
        worker.run(T + 5)
    assert len(warnings_of(caplog)) == 1


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_what_lay_in_the_port_as_it_was_opened_is_not_told(
    protocol: LineProtocol, caplog: pytest.LogCaptureFixture
) -> None:
    """Nor are single bytes later; the diagnostics count them."""
    worker = line_of(protocol)
    worker.bus_line.foreign = b"\x00" * 40
    foreign_frame_every(worker, b"\xff", 0.05, T + 20)
    with caplog.at_level(logging.WARNING):
        worker.run(T + 20)
    assert warnings_of(caplog) == []
    measured = [m for _, m in worker.measured if isinstance(m, LineMeasured)]
    assert measured[-1].unsolicited_bytes > 40


def test_late_replies_are_not_taken_for_another_master(caplog: pytest.LogCaptureFixture) -> None:
    """A module that answers too late is slow, and its errors tell of that."""
    worker = BusWorker(make_line(make_station(1), protocol=LineProtocol.MODBUS_RTU))
    worker.line.at(T, lambda: worker.bus_line.faults.set("late", delay_s=0.25, probability=0.2))
    with caplog.at_level(logging.WARNING):
        worker.run(T + 60)
    assert worker.bus_line.bus.counters.late_bytes > 0
    assert warnings_of(caplog) == []


def test_text_of_a_gateway_is_named(caplog: pytest.LogCaptureFixture) -> None:
    """A heartbeat text of a gateway is named as such; the modules stay online."""
    config = make_line(make_station(1), make_station(2, DO100), protocol=LineProtocol.WISCO)
    worker = BusWorker(replace(config, port="tcp://gateway:4196"))
    foreign_frame_every(worker, b"USR-TCP232-T2", 1.0, T + 20)
    with caplog.at_level(logging.WARNING):
        worker.run(T + 20)
    (warning,) = warnings_of(caplog)
    assert "another master" not in warning
    assert warning.endswith(
        "text from the gateway: registration or heartbeat packets are on; switch them off there "
        "(heard: 'USR-TCP232-T2')"
    )
    assert [online for _, online in worker.online_at("s1")] == [True]
    functions = [f[3:5] for at, f in worker.line.wire if at > T and f.startswith(b":")]
    assert set(functions) <= {b"03"}  # its settings, as ever; its states in Wisco frames
