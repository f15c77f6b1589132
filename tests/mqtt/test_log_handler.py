import logging
import queue
from collections.abc import Iterator

import pytest

from bridge.mqtt.log_handler import BridgeLogHandler, LogLine

pytestmark = pytest.mark.warns  # what goes wrong here is logged

LOG = logging.getLogger("bridge.test_log_handler")


@pytest.fixture
def lines() -> Iterator[queue.Queue[LogLine]]:
    """Return the queue of a handler at the root of the log, for at most three lines."""
    taken: queue.Queue[LogLine] = queue.Queue(3)
    handler = BridgeLogHandler(taken)
    logging.getLogger().addHandler(handler)
    yield taken
    logging.getLogger().removeHandler(handler)


def _all(lines: queue.Queue[LogLine]) -> list[LogLine]:
    return [lines.get_nowait() for _ in range(lines.qsize())]


def test_warnings_and_errors_are_handed_on(lines: queue.Queue[LogLine]) -> None:
    """A warning goes on with its line and station; what is less does not."""
    LOG.setLevel(logging.DEBUG)
    LOG.info("all is well")
    LOG.warning("port %s is gone", "COM1", extra={"line": "main"})
    LOG.error("wrong model", extra={"station": "garage"})
    assert _all(lines) == [
        LogLine("warning", "port COM1 is gone", line="main"),
        LogLine("error", "wrong model", station_id="garage"),
    ]


def test_what_the_client_says_is_not_published(lines: queue.Queue[LogLine]) -> None:
    """Trouble with publishing is not published: that would go round for ever."""
    logging.getLogger("bridge.mqtt.client").error("cannot publish")
    assert _all(lines) == []


def test_a_full_queue_loses_lines_and_never_waits(lines: queue.Queue[LogLine]) -> None:
    """A flood of warnings neither blocks nor fails who logs."""
    for number in range(10):
        LOG.warning("%d", number)
    assert [line.message for line in _all(lines)] == ["0", "1", "2"]


def test_a_long_message_is_cut(lines: queue.Queue[LogLine]) -> None:
    """One line stays of a bearable size."""
    LOG.warning("x" * 10_000)
    assert len(_all(lines)[0].message) == 1000


def test_a_broken_record_harms_nobody(
    lines: queue.Queue[LogLine], capsys: pytest.CaptureFixture[str]
) -> None:
    """A logging call with wrong arguments is reported by logging, and not handed on."""
    record = LOG.makeRecord(LOG.name, logging.WARNING, "f", 1, "%d", ("no number",), None)
    BridgeLogHandler(lines).handle(record)
    assert _all(lines) == []
    assert "Logging error" in capsys.readouterr().err
