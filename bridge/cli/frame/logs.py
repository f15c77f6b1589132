"""Where the log goes: stderr, one line an event.

A file gets time, zone and module; a person at a terminal the time of day; the journal adds its own.
"""

import logging
import os
import sys
from collections.abc import Mapping
from datetime import datetime

LEVELS = ("debug", "info", "warning", "error")

# sd-daemon(3): the journal takes a priority from a `<N>` that a line starts with.
_JOURNAL_PRIORITIES = {
    logging.DEBUG: 7,
    logging.INFO: 6,
    logging.WARNING: 4,
    logging.ERROR: 3,
    logging.CRITICAL: 2,
}
_JOURNAL_ERROR = 3


class OneLineFormatter(logging.Formatter):
    """Makes one line of an event, whatever its message or traceback holds."""

    def format(self, record: logging.LogRecord) -> str:
        """Give the event without line breaks: a broker's text cannot forge a second event."""
        return super().format(record).replace("\r", "\\r").replace("\n", "\\n")

    def formatTime(self, record: logging.LogRecord, datefmt: str | None = None) -> str:  # noqa: N802 - logging's name
        """Give ISO 8601 with milliseconds and zone."""
        moment = datetime.fromtimestamp(record.created).astimezone()
        return moment.strftime(datefmt) if datefmt else moment.isoformat(timespec="milliseconds")


class JournalFormatter(OneLineFormatter):
    """The same for systemd's journal: priority first, no time."""

    def format(self, record: logging.LogRecord) -> str:
        """Put the priority before the event."""
        priority = _JOURNAL_PRIORITIES.get(record.levelno, _JOURNAL_ERROR)
        return f"<{priority}>{super().format(record)}"


def configure_logging(level: str, environ: Mapping[str, str]) -> None:
    """Send every event of `level` and above to stderr."""
    handler = logging.StreamHandler(sys.stderr)
    if _stderr_is_journal(environ):
        handler.setFormatter(JournalFormatter("%(name)s: %(message)s"))
    elif sys.stderr.isatty():
        handler.setFormatter(
            OneLineFormatter("%(asctime)s %(levelname)-7s %(message)s", "%H:%M:%S")
        )
    else:
        text = "%(asctime)s %(levelname)s %(name)s: %(message)s"
        handler.setFormatter(OneLineFormatter(text))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)


def _stderr_is_journal(environ: Mapping[str, str]) -> bool:
    # systemd.exec(5): the variable is inherited by shells and redirected children too, so it
    # counts only where it names the very file that stderr is.
    try:
        stderr = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):  # closed, or replaced by an object without a descriptor
        return False
    return environ.get("JOURNAL_STREAM") == f"{stderr.st_dev}:{stderr.st_ino}"
