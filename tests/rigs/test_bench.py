"""The benchmark's own parts: its arithmetic is that of the protocol, its figures are right."""

import pytest
from bench.arithmetic import Limit, Physics
from bench.figures import Spread, Topic, cycles, delays_of_inputs
from bench.frames import reads_of
from bench.measure import Result
from bench.report import markdown
from bench.wire import Seen

from bridge.drivers import driver_for
from bridge.model import DIO100, LineProtocol


def test_the_limit_is_that_of_the_protocols_examples() -> None:
    """At 57600 baud a read of inputs takes 8.1 ms over RTU, 4.8 ms over Wisco."""
    rtu = Limit.of("modbus-rtu", Physics.of("modbus-rtu", 57600, 0.002))
    wisco = Limit.of("wisco", Physics.of("wisco", 57600, 0.002))
    assert rtu.inputs_s == pytest.approx(0.0081, abs=5e-5)
    assert wisco.inputs_s == pytest.approx(0.0048, abs=5e-5)
    assert rtu.cycle_s(32) == pytest.approx(0.513, abs=5e-4)


@pytest.mark.parametrize("protocol", list(LineProtocol))
def test_the_bare_loop_asks_what_the_bridge_asks(protocol: LineProtocol) -> None:
    """The same frames, though put together elsewhere, and replies of the same length."""
    driver = driver_for(protocol, 7, DIO100)
    asked = reads_of(protocol, 7)
    reads = (driver.read_inputs, driver.read_outputs)
    assert asked == tuple((read.frame, read.reply_chars) for read in reads)


def test_a_spread_has_middle_and_end() -> None:
    """In milliseconds; nothing has none."""
    assert Spread.of(n / 1000 for n in range(101)) == Spread(50.0, 99.0, 101, 100.0)
    assert Spread.of([]) is None


def test_a_cycle_is_from_one_read_of_inputs_to_the_next_of_the_same_station() -> None:
    """Other lines and other reads do not count."""
    reads = [
        (1.0, 0, 1, "inputs"),
        (1.1, 0, 2, "inputs"),
        (1.2, 1, 1, "inputs"),
        (1.3, 0, 1, "outputs"),
        (1.5, 0, 1, "inputs"),
    ]
    assert cycles(reads, 0) == Spread(500.0, 500.0, 1, 500.0)


def test_a_change_that_nobody_published_counts_as_a_minute() -> None:
    """A change that was never published counts as a minute, so it cannot improve a figure."""
    seen = Seen(toggles=[(1.0, 0, 3, 4, True), (2.0, 0, 3, 4, False)])
    heard = [(0.5, "bench/l0-s3/di/4", b"ON"), (1.25, "bench/l0-s3/di/4", b"ON")]
    assert delays_of_inputs(seen, heard) == Spread(250.0, 60000.0, 2, 60000.0)


def test_another_program_may_publish_elsewhere_and_in_other_words() -> None:
    """The topics and payloads of another program are given by a pattern."""
    seen = Seen(toggles=[(1.0, 0, 3, 4, True)])
    heard = [(1.1, "peer/3/di4", b"0"), (1.5, "peer/3/di4", b"1")]
    topic = Topic("peer/{station}/di{channel}", b"1", b"0")
    assert delays_of_inputs(seen, heard, topic) == Spread(500.0, 500.0, 1, 500.0)


def test_what_was_not_measured_is_a_dash_in_the_tables() -> None:
    """A case without a bare loop has no ratio to it."""
    result = Result("E wisco", 0.1, 276.0, 670.0, plain_cycles=[Spread(280.0, 281.0, 9)])
    plain, own = markdown([result]).strip().split("\n\n")
    assert plain.splitlines()[2] == "| E wisco | 276.0 | - | 280.0 | 1.014 | - | 0, 0 | 0.1-0.0 |"
    assert own.splitlines()[2] == "| E wisco | - | - | - | - | - | 0 (670) | 0, 0 | 0.0 |"
