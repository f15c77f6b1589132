"""What kills came to, as lines to read. No I/O here."""

from collections.abc import Iterator, Mapping, Sequence

from fleet.kills import PROMISED_S, Killing


def table(name: str, killing: Killing) -> Iterator[str]:
    """Yield the lines about one cluster."""
    found, tally = killing.found, killing.tally
    yield f"{name}: {sum(found.kills.values())} nodes and links taken away"
    yield f"{'':<10}{'kills':>6}  {'all true on those left':<28}{'all true after the return':<28}"
    for kind, kills in sorted(found.kills.items()):
        without, again = _spread(found.without[kind]), _spread(found.again[kind])
        yield f"{kind:<10}{kills:>6}  {without:<28}{again:<28}"
    yield (
        f"not true within {PROMISED_S:.0f} s: {_late(found.again)} after all is back, "
        f"{_late(found.without)} while some were missing"
    )
    yield (
        f"commands: {tally.sent} sent, {tally.answered} answered, {tally.lost} lost with a node, "
        f"{tally.missing} without a verdict; {killing.clients.duplicates} brought twice and refused"
    )
    yield (
        f"relays: {tally.switched} orders; {tally.wrong} without a command, {tally.late} late, "
        f"{tally.twice} pulses twice"
    )
    yield from (f"  {text}" for text in (*found.broken[:10], *tally.examples[:10]))


def kept(killing: Killing) -> bool:
    """Return whether no relay was switched wrongly; how fast a broker recovers is a figure."""
    tally = killing.tally
    return not (tally.wrong or tally.late or tally.twice)


def _late(by_kind: Mapping[str, Sequence[float]]) -> str:
    times = [took_s for some in by_kind.values() for took_s in some]
    return f"{sum(took_s > PROMISED_S for took_s in times)} of {len(times)}"


def _spread(times: Sequence[float]) -> str:
    if not times:
        return "-"
    ordered = sorted(times)
    median, longest = ordered[len(ordered) // 2], ordered[-1]
    return f"p50 {median:.1f} s, longest {longest:.1f} s"
