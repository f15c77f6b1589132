"""Tells the panel of warnings and errors of every thread."""

import logging

from bridge.web.story import Story

_MESSAGE_CHARS = 1000


class PanelLog(logging.Handler):
    """Hands records to the story; what repeats is bounded where it is logged."""

    def __init__(self, story: Story) -> None:
        super().__init__(logging.WARNING)
        self._story = story

    def emit(self, record: logging.LogRecord) -> None:
        """Take one record. Never waits: any thread may log."""
        try:
            where = getattr(record, "station", None) or getattr(record, "line", None) or ""
            message = record.getMessage()[:_MESSAGE_CHARS]
            self._story.logged(record.levelname.lower(), message, str(where))
        except Exception:  # noqa: BLE001 - logging's rule: a record that cannot be told does no harm
            self.handleError(record)
