"""The settings of a line that follow from what was measured, with the figure behind each. Pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from bridge.commission.verify.sampling import Samples
from bridge.config.schema import LineConfig
from bridge.drivers.modbus import ModbusDriver
from bridge.model import DO100
from bridge.transport.timing import LineTiming

_MARGIN = 1.25  # over the longest that was seen
_LEAST_LATE_WINDOW_S = 0.3  # what a few minutes do not show may still come
_FILLS = 0.7  # of the time that `timeout: auto` leaves a module


@dataclass(frozen=True, slots=True)
class Proposed:
    """One setting.

    Attributes:
        now: In force, as the configuration writes it.
        value: What follows, as the configuration writes it.
        why: The figures behind it.
    """

    name: str
    now: str
    value: str
    why: str


def proposed(line: LineConfig, samples: Sequence[Samples]) -> tuple[Proposed, ...]:
    """Return what follows; without a reply nothing does."""
    timed = [one for one in samples if one.begins_s]
    if not timed:
        return ()
    timing = LineTiming.from_config(line)
    usual_s = max(one.quantile_s(0.5) for one in timed)
    longest_s = max(one.longest_s for one in timed)
    count = sum(len(one.begins_s) for one in timed)
    turnaround_s = max(0.001, math.ceil(usual_s * 1000 - 0.05) / 1000)
    longest = f"the longest of {count} replies began after {longest_s * 1000:.0f} ms"
    return (
        Proposed(
            "turnaround",
            _ms(line.turnaround_s),
            _ms(turnaround_s),
            f"half of the replies of the slowest module began within {usual_s * 1000:.1f} ms",
        ),
        Proposed(
            "timeout",
            "auto" if line.timeout_s is None else _ms(line.timeout_s),
            _timeout(line, timing, turnaround_s, longest_s),
            longest,
        ),
        _silence(line, timing, timed),
        Proposed(
            "late_window",
            _ms(line.late_window_s),
            _ms(max(_LEAST_LATE_WINDOW_S, _up(_MARGIN * longest_s))),
            f"{longest}; never below {_ms(_LEAST_LATE_WINDOW_S)}",
        ),
    )


def _timeout(line: LineConfig, timing: LineTiming, turnaround_s: float, longest_s: float) -> str:
    if longest_s <= _FILLS * (turnaround_s + timing.margin_s):
        return "auto"
    # The longest exchange of the daemon.
    longest = ModbusDriver(1, DO100, line.protocol.in_modbus).read_settings
    chars = len(longest.frame) + longest.reply_chars
    return _ms(_up(chars * timing.char_s + timing.end_silence_s + _MARGIN * longest_s))


def _silence(line: LineConfig, timing: LineTiming, samples: Sequence[Samples]) -> Proposed:
    now = "auto" if line.silence_s is None else _ms(line.silence_s)
    needs = [one.needs_s for one in samples if one.needs_s is not None]
    if not needs:
        return Proposed("silence", now, now, "not tried")
    needs_s, value = max(needs), "auto"
    if needs_s > timing.end_silence_s:
        value = _ms(2 * needs_s)
    return Proposed("silence", now, value, f"{needs_s * 1000:.1f} ms were enough for all modules")


def _up(seconds: float) -> float:
    return math.ceil(seconds * 100) / 100


def _ms(seconds: float) -> str:
    return f"{seconds * 1000:g}ms"
