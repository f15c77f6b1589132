"""How long things take on a line: characters, silences, time-outs; and how a silence is kept."""

import time
from dataclasses import dataclass

from bridge.clock import boot_s
from bridge.config.schema import LineConfig
from bridge.model import LineProtocol

_BITS_PER_CHAR = 10  # docs/protocol.md section 1: 1 start, 8 data, no parity, 1 stop
_RTU_SILENCE_CHARS = 3.5
_RTU_LEAST_SILENCE_S = 0.00175  # above 19200 baud
# On top of what the wire takes: adapters, networks and this computer are late at times.
_MARGIN_S = 0.1
_OVERSLEPT_S = 0.0001


@dataclass(frozen=True, slots=True)
class LineTiming:
    """The times of one line.

    Attributes:
        baud: Bits a second.
        turnaround_s: What a module takes before it answers.
        silence_s: What we keep before each request.
        end_silence_s: What a module waits for before it takes a request as ended.
        fixed_timeout_s: The configured time-out of every exchange; None: worked out.
        margin_s: What is added to a time-out that is worked out.
    """

    baud: int
    turnaround_s: float
    silence_s: float
    end_silence_s: float
    fixed_timeout_s: float | None = None
    margin_s: float = _MARGIN_S

    @classmethod
    def from_config(cls, line: LineConfig) -> "LineTiming":
        """Work out what the configuration leaves to us."""
        rtu = line.protocol is LineProtocol.MODBUS_RTU
        end_silence_s = rtu_silence_s(line.baud) if rtu else 0.0
        return cls(
            baud=line.baud,
            turnaround_s=line.turnaround_s,
            silence_s=end_silence_s if line.silence_s is None else line.silence_s,
            end_silence_s=end_silence_s,
            fixed_timeout_s=line.timeout_s,
        )

    @property
    def char_s(self) -> float:
        """Return what one character takes on the wire."""
        return _BITS_PER_CHAR / self.baud

    def timeout_s(self, request_chars: int, reply_chars: int) -> float:
        """Return how long an exchange may take, from the first byte of its request on."""
        if self.fixed_timeout_s is not None:
            return self.fixed_timeout_s
        wire_s = (request_chars + reply_chars) * self.char_s
        return wire_s + self.end_silence_s + self.turnaround_s + self.margin_s

    def floor_s(self, request_chars: int, reply_chars: int) -> float:
        """Return the least that an exchange takes of the line (docs/protocol.md section 5)."""
        wire_s = (request_chars + reply_chars) * self.char_s
        return wire_s + self.end_silence_s + self.silence_s + self.turnaround_s


def sleep_exactly(seconds: float) -> None:
    """Sleeps, and ends no sooner and hardly later.

    A plain sleep is late by some tens of microseconds, which each silence of each exchange would
    cost the line: so the last of it is spent looking at the clock.
    """
    until = boot_s() + seconds
    if seconds > _OVERSLEPT_S:
        time.sleep(seconds - _OVERSLEPT_S)
    while boot_s() < until:
        pass


def rtu_silence_s(baud: int) -> float:
    """Return the silence that sets RTU frames apart (docs/protocol.md section 5)."""
    # Up to 19200 baud 3.5 characters take longer than the least anyhow.
    return max(_RTU_SILENCE_CHARS * _BITS_PER_CHAR / baud, _RTU_LEAST_SILENCE_S)
