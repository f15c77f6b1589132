"""Decides when bytes that were not requested are worth a warning (docs/failures.md A14)."""

import re
from collections.abc import Callable

REMIND_S = 600.0
# For this time after they were heard, more replies to another master may come.
CONTESTED_S = 30.0
# Adapters and plugs make a byte or two themselves when they switch. The shortest frame of another
# master has seven (docs/protocol.md section 2), and its module answers.
_PIECE_BYTES = 3
_ENOUGH_BYTES = 6
_TOGETHER_S = 5.0
_TEXT = re.compile(rb"[\x20-\x7e\r\n\t]+")
# The characters of Wisco and Modbus ASCII frames, and of parts of them (docs/protocol.md section
# 2).
_OF_FRAMES = re.compile(rb"[0-9A-F#:>=,DIOERKWHX\r\n]*")
_BEGINS_REPLY = re.compile(rb"DI>|DO>|EE>|ERR=")
_HARDWARE_ADDRESS = re.compile(rb"(?:[0-9A-F]{2}[:-]){5}[0-9A-F]{2}\s*", re.IGNORECASE)


class StrayWatch:
    """Watches one line. `warn` gets the number of bytes, and the last bytes.

    `gateway`: the line is behind a program that may send bytes of its own. Time is an argument
    (`bridge.clock.boot_s`).
    """

    def __init__(self, warn: Callable[[int, bytes], None], *, gateway: bool = False) -> None:
        self._warn = warn
        self._gateway = gateway
        self._untold = 0
        self._last_at = 0.0
        self._remind_at = 0.0
        self._contested_until = 0.0

    def heard(self, count: int, evidence: bytes, now: float) -> None:
        """Count bytes that came together."""
        if count < _PIECE_BYTES:
            return
        if not (self._gateway and is_text(evidence)):
            self._contested_until = now + CONTESTED_S
        if now >= self._remind_at and now - self._last_at > _TOGETHER_S:
            self._untold = 0
        self._last_at = now
        self._untold += count
        if self._untold >= _ENOUGH_BYTES and now >= self._remind_at:
            self._warn(self._untold, evidence)
            self._untold = 0
            self._remind_at = now + REMIND_S

    def is_contested(self, now: float) -> bool:
        """Return whether a reply may belong to another master (docs/failures.md F12)."""
        return now < self._contested_until


def is_text(heard: bytes) -> bool:
    """Return whether it is text and no part of a frame, as some gateways send by themselves.

    They send registration packets at the connection, heartbeat packets every few seconds.
    """
    if _HARDWARE_ADDRESS.fullmatch(heard):
        return True
    if not _TEXT.fullmatch(heard) or _BEGINS_REPLY.search(heard):
        return False
    return not _OF_FRAMES.fullmatch(heard)
