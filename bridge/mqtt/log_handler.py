"""Passes warnings and errors of every thread to the main thread, which publishes them."""

import logging
import queue
from dataclasses import dataclass

MOST_WAITING = 100
_MESSAGE_CHARS = 1000

# A report about the broker cannot be sent through the broker: it would fail and be logged again.
_NOT_PUBLISHED = "bridge.mqtt.client"


@dataclass(frozen=True, slots=True)
class LogLine:
    """One warning or error; `line` and `station_id` come from the `extra` of the logging call."""

    level: str
    message: str
    line: str | None = None
    station_id: str | None = None


class BridgeLogHandler(logging.Handler):
    """Queues the records for `B/bridge/log`. A full queue drops the newest."""

    def __init__(self, lines: queue.Queue[LogLine]) -> None:
        super().__init__(logging.WARNING)
        self._lines = lines

    def emit(self, record: logging.LogRecord) -> None:
        """Queue one record. Never waits: any thread may log."""
        if record.name == _NOT_PUBLISHED:
            return
        try:
            self._lines.put_nowait(_line_of(record))
        except queue.Full:
            pass  # it is still in the log of the process
        except Exception:  # noqa: BLE001 - logging's rule: a record that cannot be told does no harm
            self.handleError(record)


def _line_of(record: logging.LogRecord) -> LogLine:
    return LogLine(
        level=record.levelname.lower(),
        message=record.getMessage()[:_MESSAGE_CHARS],
        line=getattr(record, "line", None),
        station_id=getattr(record, "station", None),
    )
