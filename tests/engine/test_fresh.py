"""Reads that a write builds upon, on the real bus with replies that come late."""

from support.bus_worker import BusLine
from support.virtual_worker import make_line, make_station

from bridge.engine.fresh import goes_out_at, read_fresh
from bridge.engine.station import Station
from bridge.model import LineProtocol

LATE_S = 0.2  # later than the time-out, and well within the late window


class Reader:
    """One module on a Modbus line, read as a write reads it.

    Attributes:
        line: The line, on its virtual clock.
        reads: When each read was begun.
        loses_one_each_time: Of each read the first request is lost.
    """

    def __init__(self) -> None:
        config = make_line(make_station(), protocol=LineProtocol.MODBUS_RTU)
        self.line = BusLine(config)
        self.bus = self.line.open(config)
        self.station = Station(config.stations[0], config)
        self.reads: list[float] = []
        self.loses_one_each_time = False

    def fresh(self) -> int | None:
        """Reads the outputs with `read_fresh`."""
        return read_fresh(self.bus, 1, self.line.clock, self._read)

    def goes_out_at(self) -> float:
        """When a write would go out."""
        return goes_out_at(self.bus, 1, self.line.clock)

    def late(self, times: int) -> None:
        """So many replies come late."""
        self.line.faults.set("late", times=times, delay_s=LATE_S)

    def _read(self) -> int | None:
        self.reads.append(self.line.now)
        if self.loses_one_each_time:
            self.line.faults.set("deaf", times=1)
        return self.station.read_outputs(self.bus, 2)


def test_one_read_does_where_every_reply_is_in_time() -> None:
    """Nothing is waited for, and the write can go at once."""
    reader = Reader()
    reader.line.modules[1].set_output(3, True)
    assert reader.fresh() == 0b100
    assert len(reader.reads) == 1
    assert reader.goes_out_at() == reader.line.now


def test_after_a_lost_try_it_is_read_again_when_nothing_can_be_late_any_more() -> None:
    """Else the write would have to wait for the late reply after its read."""
    reader = Reader()
    reader.late(1)
    assert reader.fresh() == 0
    first, second = reader.reads
    assert second - first > LATE_S
    assert reader.goes_out_at() == reader.line.now


def test_a_reply_that_is_due_from_before_passes_first() -> None:
    """The read that missed it was made by somebody else: a poll."""
    reader = Reader()
    reader.late(1)
    assert reader.station.read_outputs(reader.bus, 1) is None
    due_until = reader.goes_out_at()
    assert due_until > reader.line.now
    assert reader.fresh() == 0
    assert reader.reads == [due_until]


def test_where_tries_are_lost_each_time_there_is_no_fresh_read() -> None:
    """A write upon a read that is old by then would write back what is not so any more."""
    reader = Reader()
    reader.loses_one_each_time = True
    assert reader.fresh() is None
    assert len(reader.reads) == 2


def test_a_module_that_does_not_answer_is_not_asked_another_round() -> None:
    """The line is not held up for it."""
    reader = Reader()
    reader.line.modules[1].away = True
    assert reader.fresh() is None
    assert len(reader.reads) == 1
