"""Asks one module a read again and again: how fast it is, how sure the cable, how much silence."""

import math
from dataclasses import dataclass, field

from bridge.commission.verify.assumptions import Finding, as_assumed, differs, not_tried
from bridge.commission.verify.talk import Talk
from bridge.errors import BadReplyError, ExchangeError, NoReplyError, RefusedError
from bridge.model import LineProtocol
from bridge.transport.bus import EchoDamagedError
from bridge.transport.timing import LineTiming

_LATE_LOOKS = 10  # of 30 ms each: what comes after the time-out
_IDLE_LOOKS = 2
_NOT_THERE = 8  # asked in vain: it is not asked a hundred times
_SILENCE_ASKS = 20
# One reply in a hundred is lost by chance: six of twenty are once in twenty-five million times.
_SILENCE_LOST = 6
_SILENCES_S = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
_CONFIDENCE = 0.95
_ADAPTER_S = 0.001  # an adapter's own delay
_REFUSAL_CHARS = {LineProtocol.WISCO: 6, LineProtocol.MODBUS_RTU: 5, LineProtocol.MODBUS_ASCII: 11}


@dataclass(slots=True)
class Errors:
    """Describe how exchanges went, by kind of error."""

    asked: int = 0
    silent: int = 0
    garbled: int = 0
    late: int = 0
    echo: int = 0
    idle_bytes: int = 0

    @property
    def failed(self) -> int:
        """Return how many exchanges were no good."""
        return self.silent + self.garbled + self.late + self.echo

    def add(self, other: "Errors") -> None:
        """Count another's too."""
        for name in self.__slots__:
            setattr(self, name, getattr(self, name) + getattr(other, name))


@dataclass(slots=True)
class Samples:
    """What was measured of one module, in seconds.

    Attributes:
        begins_s: From the end of a request until its reply began, wire and silences left out.
        needs_s: The least silence before a request that it needed; None: not tried.
    """

    begins_s: list[float] = field(default_factory=list)
    errors: Errors = field(default_factory=Errors)
    needs_s: float | None = None

    @property
    def longest_s(self) -> float:
        """Return the longest time that any reply took to begin."""
        return max(self.begins_s, default=0.0)

    def quantile_s(self, share: float) -> float:
        """Return the time that so many replies were no slower than."""
        ordered = sorted(self.begins_s)
        return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else 0.0


def sample(talk: Talk, timing: LineTiming, count: int) -> Samples:
    """Ask a read so often."""
    samples = Samples()
    for _ in range(count):
        samples.errors.asked += 1
        _ask(talk, timing, samples)
        if samples.errors.silent == samples.errors.asked == _NOT_THERE:
            return samples
    for _ in range(_IDLE_LOOKS):
        heard = talk.line.listen()
        # The LF of a CR LF is no noise: it is a finding of `line-end`.
        samples.errors.idle_bytes += len(heard.strip(b"\n") if talk.is_text else heard)
    return samples


def _ask(talk: Talk, timing: LineTiming, samples: Samples) -> None:
    request, chars = talk.driver.read_outputs, talk.driver.read_outputs.reply_chars
    try:
        talk.line.exchange(request, protected=talk.driver.protected)
    except RefusedError:
        chars = _REFUSAL_CHARS[talk.protocol]
    except NoReplyError:
        if not any(talk.line.strays() for _ in range(_LATE_LOOKS)):
            samples.errors.silent += 1
            return
    except EchoDamagedError:
        samples.errors.echo += 1
        return
    except BadReplyError:
        samples.errors.garbled += 1
        return
    wire_s = (len(request.frame) + chars) * timing.char_s + timing.end_silence_s
    began_s = max(0.0, talk.line.now() - talk.line.sent_at - wire_s)
    samples.begins_s.append(began_s)
    # What only our patience caught is late for the bridge.
    samples.errors.late += began_s > timing.turnaround_s + timing.margin_s


def silence_before(talk: Talk, timing: LineTiming, samples: Samples) -> Finding:
    """Find the least silence before a request with which the module hears all of them."""
    guide_s = timing.end_silence_s
    if talk.line.quieter(guide_s) is None:
        return not_tried("silence-before", "the bridge at work keeps its own silence")
    for silence_s in (0.0, *sorted({guide_s, *_SILENCES_S} - {0.0})):
        if not _is_enough(talk, silence_s):
            continue
        samples.needs_s = silence_s
        seen = f"{silence_s * 1000:.1f} ms are enough"
        if silence_s <= guide_s + 1e-9:
            return as_assumed("silence-before", seen)
        return differs("silence-before", f"{seen}, {guide_s * 1000:.1f} ms are not")
    return not_tried("silence-before", "requests are lost whatever the silence")


def _is_enough(talk: Talk, silence_s: float) -> bool:
    line, lost = talk.line.quieter(silence_s) or talk.line, 0
    for _ in range(_SILENCE_ASKS):
        try:
            line.exchange(talk.driver.read_outputs, protected=talk.driver.protected)
        except NoReplyError:
            lost += 1
        except ExchangeError:
            pass
        if lost >= _SILENCE_LOST:
            return False
    return True


def timing_findings(
    samples: Samples, timing: LineTiming, late_window_s: float
) -> tuple[Finding, Finding]:
    """Judge turnaround and late replies against the settings in force."""
    if not samples.begins_s:
        none = "no reply could be timed"
        return not_tried("turnaround", none), not_tried("late-reply", none)
    usual_s, longest_s = samples.quantile_s(0.5), samples.longest_s
    seen = (
        f"p50 {usual_s * 1000:.1f} ms, p99 {samples.quantile_s(0.99) * 1000:.1f} ms, longest "
        f"{longest_s * 1000:.1f} ms of {len(samples.begins_s)}"
    )
    slow = usual_s > timing.turnaround_s + _ADAPTER_S
    too_late = longest_s > timing.turnaround_s + timing.margin_s + late_window_s
    late = f"latest {longest_s * 1000:.0f} ms, {samples.errors.late} after the time-out"
    return (
        (differs if slow else as_assumed)("turnaround", seen),
        (differs if too_late else as_assumed)("late-reply", late),
    )


def upper_bound(failed: int, asked: int) -> float:
    """Return the error rate that is exceeded with 5 % of chance at most (Clopper-Pearson)."""
    if not asked or failed >= asked:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        if _at_most(failed, asked, middle) > 1 - _CONFIDENCE:
            low = middle
        else:
            high = middle
    return high


def _at_most(failed: int, asked: int, rate: float) -> float:
    """Return the chance of no more failures than these."""
    if rate <= 0.0 or rate >= 1.0:
        return 1.0 if rate <= 0.0 else 0.0
    logs = (
        math.lgamma(asked + 1)
        - math.lgamma(k + 1)
        - math.lgamma(asked - k + 1)
        + k * math.log(rate)
        + (asked - k) * math.log1p(-rate)
        for k in range(failed + 1)
    )
    return math.fsum(map(math.exp, logs))
