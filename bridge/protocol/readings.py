"""Names the reading of docs/protocol.md that a module seems to take otherwise, by its replies."""

import re

from bridge.errors import BadReplyError, ExchangeError, RefusedError

_BARE_ERROR = re.compile(rb"ERR=[0-9]\Z")
_STRANGE_ERROR = re.compile(rb"ERR=[^1-6]\r")
_LAST_STANDARD_CODE = 6  # of ERR=, and of Modbus those that a module of this kind can give


def reading_of(error: ExchangeError) -> str | None:
    """Return the id of the reading that explains this error; None: there is none that does."""
    if isinstance(error, RefusedError):
        return "exceptions" if error.code > _LAST_STANDARD_CODE else None
    if isinstance(error, BadReplyError):
        if _BARE_ERROR.search(error.data):
            return "err-end"
        if _STRANGE_ERROR.search(error.data):
            return "exceptions"
    return None
