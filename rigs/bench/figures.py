"""The measurements of one case, and the figures that are computed from them."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from bench.wire import Seen

Read = tuple[float, int, int, str]


@dataclass(frozen=True, slots=True)
class Topic:
    """The topic of an input, and its words."""

    form: str
    on: bytes = b"ON"
    off: bytes = b"OFF"

    def message(self, line: int, address: int, channel: int, *, on: bool) -> tuple[str, bytes]:
        """Return the message that says that this input has this value."""
        topic = self.form.format(line=line, station=address, channel=channel)
        return topic, self.on if on else self.off


OURS = Topic("bench/l{line}-s{station}/di/{channel}")


@dataclass(frozen=True, slots=True)
class Spread:
    """The middle and the end of some times, in milliseconds."""

    p50: float
    p99: float
    count: int
    most: float = 0.0

    @classmethod
    def of(cls, seconds: Iterable[float]) -> "Spread | None":
        """None: there was not a single one."""
        ordered = sorted(seconds)
        if not ordered:
            return None
        last = len(ordered) - 1
        return cls(
            round(ordered[last // 2] * 1000, 3),
            round(ordered[round(last * 0.99)] * 1000, 3),
            len(ordered),
            round(ordered[last] * 1000, 3),
        )


def cycles(reads: Sequence[Read], line: int) -> Spread | None:
    """Return the times from one read of inputs to the next of the same station."""
    at: defaultdict[int, list[float]] = defaultdict(list)
    for instant, of_line, address, kind in reads:
        if kind == "inputs" and of_line == line:
            at[address].append(instant)
    return Spread.of(later - earlier for times in at.values() for earlier, later in pairwise(times))


def delays_of_inputs(
    seen: Seen, heard: Iterable[tuple[float, str, bytes]], topic: Topic = OURS
) -> Spread | None:
    """From each change of an input to its message; a change that was missed counts as 60 s."""
    arrived: defaultdict[tuple[str, bytes], list[float]] = defaultdict(list)
    for at, name, payload in heard:
        arrived[name, payload].append(at)
    delays = []
    for changed_at, line, address, channel, on in seen.toggles:
        key = topic.message(line, address, channel, on=on)
        delays.append(
            min((at - changed_at for at in arrived[key] if at > changed_at), default=60.0)
        )
    return Spread.of(delays)
