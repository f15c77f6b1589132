"""The results of the soak, against the promises."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from soak.ledger import Tally
from soak.samples import Sample, growth

WARM_AFTER_S = 15 * 60.0
RSS_MAY_GROW_KIB = 256
OBJECTS_MAY_GROW = 200  # of some 50,000: a queue's block, a connection's buffers
LOG_LINES_AN_HOUR = 20
# The deadline of 2 s, and a write with its reads on a line where each is late.
LONGEST_VERDICT_S = 5.0
BACK_WITHIN_S = 45.0  # the longest pause between two probes is 30 s


@dataclass(slots=True)
class Seen:
    """Everything that the promises are about.

    Attributes:
        steady: Log lines by dead module.
        starts: How often each dead module's line began anew: each may say once more that it is.
        stopped: How often the daemon was stopped while motors ran.
        stops: What was wrong with that.
        not_back: What was not as it should be, though everything had been undone.
        longest_back_s: The longest time from the last undoing to everything being well.
        ended: How the daemon ended before it was told to; None: it did not.
        cpu: The share of one processor that it used.
    """

    minutes: float
    samples: list[Sample] = field(default_factory=list)
    troubles: Counter[str] = field(default_factory=Counter)
    tally: Tally = field(default_factory=Tally)
    kinds: Counter[str] = field(default_factory=Counter)
    steady: Counter[str] = field(default_factory=Counter)
    starts: Counter[str] = field(default_factory=Counter)
    stopped: int = 0
    stops: list[str] = field(default_factory=list)
    not_back: list[str] = field(default_factory=list)
    longest_back_s: float = 0.0
    ended: str | None = None
    exit_status: int | None = None
    cpu: float = 0.0

    @property
    def warm(self) -> list[Sample]:
        """The samples after minute 15, or after a quarter of a shorter run."""
        since = min(WARM_AFTER_S, self.minutes * 60 / 4)
        return [sample for sample in self.samples if sample.at >= since] or self.samples[-1:]


def describe(seen: Seen) -> Iterator[str]:
    """The figures, a line each."""
    warm, tally = seen.warm, seen.tally
    hours = seen.minutes / 60
    rss = growth(warm, [sample.rss for sample in warm])
    objects = growth(warm, [sample.objects for sample in warm])
    yield f"minutes: {seen.minutes:g}; samples after warming up: {len(warm)}"
    yield f"troubles: {_counts(seen.troubles)}"
    yield f"RSS growth: {rss.by:+.0f} KiB, slope {rss.per_hour:+.0f} KiB/h"
    dirty = growth(warm, [sample.dirty for sample in warm])
    yield f"private dirty memory: {dirty.by:+.0f} KiB, slope {dirty.per_hour:+.0f} KiB/h"
    yield f"descriptors: {_span([sample.descriptors for sample in warm])}"
    yield f"threads: {_span([sample.threads for sample in warm])}"
    yield (
        f"objects: {_span([sample.objects for sample in warm])}, growth {objects.by:+.0f}, "
        f"slope {objects.per_hour:+.0f}/h"
    )
    yield f"processor: {100 * seen.cpu:.0f} % of one"
    yield "log lines an hour, by kind:"
    yield from (f"  {count / hours:8.1f}  {kind}" for kind, count in seen.kinds.most_common())
    yield f"log lines about steady faults in {hours:.2f} h: {_counts(seen.steady)}"
    yield (
        f"commands: {tally.sent} sent, {tally.answered} answered, {tally.lost} lost with a cut "
        f"link, {tally.missing} unanswered, {tally.contradicted} answered twice "
        f"({tally.told_again} told again after a cut)"
    )
    yield f"verdicts: {_counts(tally.verdicts)}"
    yield f"longest time to a verdict: {tally.longest_s:.2f} s"
    yield (
        f"relays: {tally.switched} orders; without a command {tally.wrong}, pulses twice "
        f"{tally.twice}, pulses called done and not seen {tally.not_sent}"
    )
    yield (
        f"relays switched late {tally.late}, by rules {_counts(tally.own)}, "
        f"by a hand within a write {tally.raced}"
    )
    yield f"what never may be: {_counts(tally.harms)}"
    yield f"stops with motors that run: {seen.stopped}, not in order {len(seen.stops)}"
    yield from (f"  {text}" for text in seen.stops)
    yield f"everything back after the troubles: within {seen.longest_back_s:.1f} s"
    yield from (f"  not back: {text}" for text in seen.not_back)
    yield from (f"  {text}" for text in tally.examples)
    yield f"deaths: {seen.ended or 0}; exit status at SIGTERM: {seen.exit_status}"


def broken_promises(seen: Seen) -> Iterator[str]:
    """Return the broken promises."""
    yield from _grown(seen)
    most = LOG_LINES_AN_HOUR * max(1.0, seen.minutes / 60)
    yield from (
        f"{n} log lines about {who}"
        for who, n in seen.steady.items()
        if n > most + seen.starts[who]
    )
    yield from (f"{what}: {count}" for what, count in _never(seen) if count)
    if not seen.tally.verdicts["done"]:
        yield "not one command was done"
    if seen.tally.longest_s > LONGEST_VERDICT_S:
        yield f"a verdict took {seen.tally.longest_s:.2f} s"
    if seen.ended is not None:
        yield f"the daemon ended: {seen.ended}"
    if seen.exit_status != 0:
        yield f"exit status {seen.exit_status} at SIGTERM"


def _grown(seen: Seen) -> Iterator[str]:
    warm = seen.warm
    rss = growth(warm, [sample.rss for sample in warm]).by
    if rss >= RSS_MAY_GROW_KIB:
        yield f"memory: {rss:.0f} KiB more, less than {RSS_MAY_GROW_KIB} are promised"
    if growth(warm, [sample.objects for sample in warm]).by >= OBJECTS_MAY_GROW:
        yield "the count of objects grew"
    if len({sample.descriptors for sample in warm}) > 1:
        yield "the count of descriptors is not flat"
    if len({sample.threads for sample in warm}) > 1:
        yield "the count of threads is not flat"


def _never(seen: Seen) -> Sequence[tuple[str, int]]:
    tally = seen.tally
    return (
        ("commands without a verdict", tally.missing),
        ("commands with two verdicts", tally.contradicted),
        ("relays switched without a command", tally.wrong),
        ("relays switched late", tally.late),
        *tally.harms.items(),
        ("stops that were not in order", len(seen.stops)),
        ("pulses more than asked", tally.twice),
        ("pulses called done that no relay saw", tally.not_sent),
        ("times something did not come back", len(seen.not_back)),
        ("signals that the main thread did not come to", _uncounted(seen)),
    )


def _uncounted(seen: Seen) -> int:
    return sum(sample.objects < 0 for sample in seen.samples)


def _counts(counter: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counter.most_common()) or "none"


def _span(values: Sequence[int]) -> str:
    return f"{min(values)} to {max(values)}"
