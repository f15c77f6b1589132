"""How else a module may read the manual: each reading of docs/protocol.md, turned round.

A second author's reading: `bridge.commission.verify` and this file share ids alone, not code.
"""

import re
from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum

from bridge.simulator.module import SETTINGS_AT, SimulatedModule
from bridge.simulator.wisco import checksum

SLOW_S = 0.08
VERY_SLOW_S = 0.25
NEEDED_SILENCE_S = 0.004
LATE_S = 0.6
LATE_EVERY = 50  # one reply of so many


class Dialect(StrEnum):
    """One deviation each."""

    ERR_BARE = "err-bare"
    CRLF = "crlf"
    LOWER_HEX = "lower-hex"
    NO_HEX_READS = "no-hex-reads"
    REE_SUM_ALL = "ree-sum-all"
    WEE_COUNT = "wee-count"
    WEE_SHORT = "wee-short"
    REGISTERS_APART = "registers-apart"
    ANSWERS_0 = "answers-0"
    DO100_INPUTS = "do100-inputs"
    ODD_CODES = "odd-codes"
    SECOND_ON = "second-on"
    OFF_IGNORED = "off-ignored"
    LONG_HOLD = "long-hold"
    MODE_CLEARS = "mode-clears"
    NEEDS_SILENCE = "needs-silence"
    SLOW = "slow"
    VERY_SLOW = "very-slow"
    LATE = "late"
    WISCO_ONLY = "wisco-only"
    WAKES_ON = "wakes-on"
    NO_BROADCAST = "no-broadcast"


READINGS: dict[Dialect, str] = {
    Dialect.ERR_BARE: "err-end",
    Dialect.CRLF: "line-end",
    Dialect.LOWER_HEX: "hex-case",
    Dialect.NO_HEX_READS: "cheap-frames",
    Dialect.REE_SUM_ALL: "ree-checksum",
    Dialect.WEE_COUNT: "wee-example",
    Dialect.WEE_SHORT: "wee-longest",
    Dialect.REGISTERS_APART: "register-bytes",
    Dialect.ANSWERS_0: "station-0",
    Dialect.DO100_INPUTS: "fc02-on-do100",
    Dialect.ODD_CODES: "exceptions",
    Dialect.SECOND_ON: "second-on",
    Dialect.OFF_IGNORED: "off-in-pulse",
    Dialect.LONG_HOLD: "hold-time",
    Dialect.MODE_CLEARS: "mode-change",
    Dialect.NEEDS_SILENCE: "silence-before",
    Dialect.SLOW: "turnaround",
    Dialect.VERY_SLOW: "turnaround",
    Dialect.LATE: "late-reply",
    Dialect.WISCO_ONLY: "switch-8",
    Dialect.WAKES_ON: "power-up",
    Dialect.NO_BROADCAST: "broadcast",
}

_REGISTER_BYTES = 34
_HEX_REPLY = re.compile(rb"(DI>|DO>|EE>|:)([0-9A-F]+)")


@dataclass(frozen=True, slots=True)
class Tongue:
    """The dialects of a line's modules."""

    dialects: frozenset[Dialect] = frozenset()

    @classmethod
    def of(cls, dialects: Collection[Dialect]) -> "Tongue":
        """Return the tongue with these dialects."""
        return cls(frozenset(dialects))

    def __contains__(self, dialect: Dialect) -> bool:
        return dialect in self.dialects

    def prepare(self, module: SimulatedModule) -> None:
        """Give a module the habits that are its own."""
        module.habits = module.habits | {dialect.value for dialect in self.dialects}
        if Dialect.WISCO_ONLY in self:
            module.wisco_only = True
        if Dialect.WAKES_ON in self:
            module.set_output(module.model.outputs, True)

    @property
    def silence_s(self) -> float:
        """Return the silence without which a request is not heard."""
        return NEEDED_SILENCE_S if Dialect.NEEDS_SILENCE in self else 0.0

    def delay_s(self, replies: int) -> float:
        """Return how much later than usual the reply with this number comes."""
        if Dialect.VERY_SLOW in self:
            return VERY_SLOW_S
        late = LATE_S if Dialect.LATE in self and replies % LATE_EVERY == LATE_EVERY - 1 else 0.0
        return late + (SLOW_S if Dialect.SLOW in self else 0.0)

    def wisco(self, module: SimulatedModule, frame: bytes, reply: bytes) -> bytes:
        """Say a reply to a Wisco frame as this module does."""
        command = frame[3:-1]
        if Dialect.NO_HEX_READS in self and command in {b"RDIH", b"RDOH"}:
            reply = b"ERR=1\r"
        if Dialect.DO100_INPUTS in self and not module.model.inputs:
            reply = {b"RDIH": b"DI>0000\r", b"RDI": b"DI>" + b"0" * 16 + b"\r"}.get(command, reply)
        if command.startswith(b"REE") and reply.startswith(b"EE>"):
            reply = self._ree(command, reply)
        if Dialect.ODD_CODES in self and reply.startswith(b"ERR="):
            reply = b"ERR=9\r"
        if Dialect.LOWER_HEX in self:
            reply = _lowered(reply)
        if Dialect.ERR_BARE in self and reply.startswith(b"ERR="):
            return reply[:-1]
        return reply + b"\n" if Dialect.CRLF in self else reply

    def ascii(self, reply: bytes) -> bytes:
        """Say a Modbus ASCII reply."""
        return _lowered(reply) if Dialect.LOWER_HEX in self else reply

    def _ree(self, command: bytes, reply: bytes) -> bytes:
        at, count = int(command[4:8], 16), int(command[8:12], 16)
        data = bytearray(bytes.fromhex(reply[3:-1].decode())[:-1])
        if Dialect.REGISTERS_APART in self:  # what lies here is not what the registers are
            for place in range(SETTINGS_AT, SETTINGS_AT + _REGISTER_BYTES):
                if at <= place < at + count:
                    data[place - at] = 0xFF
        covered = bytes(data)
        if Dialect.REE_SUM_ALL in self:
            covered = at.to_bytes(2, "big") + count.to_bytes(2, "big") + covered
        return f"EE>{data.hex().upper()}{checksum(covered):02X}\r".encode()


def _lowered(reply: bytes) -> bytes:
    return _HEX_REPLY.sub(lambda found: found[1] + found[2].lower(), reply)
