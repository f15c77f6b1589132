"""Names the reading of docs/protocol.md that a module seems to take otherwise, by its replies."""

import re

from bridge.errors import BadReplyError, ExchangeError, NoReplyError, RefusedError

_BARE_ERROR = re.compile(rb"ERR=[0-9]\Z")
_STRANGE_ERROR = re.compile(rb"ERR=[^1-6]\r")
_ILLEGAL_FUNCTION = 1
_LAST_STANDARD_CODE = 6  # of ERR=, and of Modbus those that a module of this kind can give


def reading_of(error: ExchangeError) -> str | None:
    """Return the id of the reading that explains why a poll failed; None: there is none."""
    if isinstance(error, NoReplyError):
        return error.reading
    if isinstance(error, RefusedError):
        if error.code == _ILLEGAL_FUNCTION:
            return "cheap-frames"
        return "exceptions" if error.code > _LAST_STANDARD_CODE else None
    if isinstance(error, BadReplyError):
        if _BARE_ERROR.search(error.data):
            return "err-end"
        if _STRANGE_ERROR.search(error.data):
            return "exceptions"
    return None
