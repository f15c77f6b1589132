"""The log: to stderr, one line for each event, with a time unless the journal adds its own."""

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
    """Formats an event as one line, whatever its message or traceback contains."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the event without line breaks, so that no text can look like a second event."""
        return super().format(record).replace("\r", "\\r").replace("\n", "\\n")

    def formatTime(self, record: logging.LogRecord, datefmt: str | None = None) -> str:  # noqa: N802 - logging's name
        """Return the time in ISO 8601 with milliseconds and zone."""
        moment = datetime.fromtimestamp(record.created).astimezone()
        return moment.strftime(datefmt) if datefmt else moment.isoformat(timespec="milliseconds")


class JournalFormatter(OneLineFormatter):
    """Formats an event for systemd's journal: priority first, no time."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the event with its priority before it."""
        priority = _JOURNAL_PRIORITIES.get(record.levelno, _JOURNAL_ERROR)
        return f"<{priority}>{super().format(record)}"


def configure_logging(level: str, environ: Mapping[str, str]) -> None:
    """Log every event of `level` and above to stderr."""
    handler = logging.StreamHandler(sys.stderr)
    if _stderr_is_journal(environ):
        handler.setFormatter(JournalFormatter("%(name)s: %(message)s"))
    else:
        text = "%(asctime)s %(levelname)s %(name)s: %(message)s"
        handler.setFormatter(OneLineFormatter(text))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)


def _stderr_is_journal(environ: Mapping[str, str]) -> bool:
    # systemd.exec(5): shells and redirected children inherit the variable, so it counts only if it
    # names the file that is stderr.
    try:
        stderr = os.fstat(sys.stderr.fileno())
    except (OSError, ValueError):  # closed, or replaced by an object without a descriptor
        return False
    return environ.get("JOURNAL_STREAM") == f"{stderr.st_dev}:{stderr.st_ino}"
