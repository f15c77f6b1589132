"""The table that is printed, and the two of docs/performance.md."""

from collections.abc import Iterable, Iterator, Sequence

from bench.figures import Spread
from bench.measure import Result

_COLUMNS = (
    ("case", 22),
    ("limit", 7),
    ("bare", 7),
    ("cycle p50", 9),
    ("p99", 7),
    ("/limit", 6),
    ("/bare", 6),
    ("worst line", 10),
    ("input p50/p99", 14),
    ("expected", 8),
    ("wire p50/p99", 13),
    ("verdict p50/p99", 15),
    ("foreign p50/p99", 15),
    ("start/limit", 11),
    ("msg/s", 6),
    ("CPU %", 11),
    ("RSS MB", 6),
    ("early+over", 10),
    ("load", 10),
)
HEAD = "  ".join(f"{name:>{width}}" for name, width in _COLUMNS)


def row(result: Result) -> str:
    """One line of the table; times in milliseconds."""
    lines = [spread for spread in result.plain_cycles if spread is not None]
    own = lines[0] if lines else None
    worst = max((spread.p50 for spread in lines), default=0.0)
    bare = result.bare_cycle
    cells = (
        result.case,
        _number(result.limit_cycle),
        _number(bare.p50) if bare else "-",
        _number(own.p50) if own else "-",
        _number(own.p99) if own else "-",
        f"{own.p50 / result.limit_cycle:.3f}" if own and result.limit_cycle else "-",
        f"{own.p50 / bare.p50:.3f}" if own and bare else "-",
        f"{worst / result.limit_cycle:.3f}" if result.limit_cycle else _number(worst),
        _both(result.inputs),
        _number(result.inputs_expected),
        _both(result.command_to_wire),
        _both(result.command_to_verdict),
        _both(result.foreign),
        f"{result.start:.0f}/{result.limit_start:.0f}",
        f"{result.messages_a_second:.0f}",
        f"{result.plain_cpu:.0f}, {result.cpu:.0f}",
        f"{result.rss_mb:.1f}",
        f"{result.early}+{result.overlapping}",
        f"{result.load_before:.1f}-{result.load_after:.1f}",
    )
    return "  ".join(f"{cell:>{width}}" for cell, (_, width) in zip(cells, _COLUMNS, strict=True))


def markdown(results: Sequence[Result]) -> str:
    """The plain cycle, then what the bridge does with its own plan; times in milliseconds."""
    plain = [_plain(result) for result in results]
    own = [_own(result) for result in results]
    return "\n".join([*_table(_PLAIN, plain), "", *_table(_OWN, own), ""])


_PLAIN = (
    *("case", "limit", "bare loop", "bridge", "to the limit", "to the bare loop"),
    *("cut short, overlapping", "load"),
)
_OWN = (
    *("case", "input to MQTT", "expected", "command to wire", "command to verdict"),
    *("foreign switch", "start (wire)", "CPU % plain, own plan", "RSS"),
)


def _plain(result: Result) -> tuple[str, ...]:
    worst = max((spread.p50 for spread in result.plain_cycles if spread), default=0.0)
    bare, limit = result.bare_cycle, result.limit_cycle
    return (
        result.case,
        f"{limit:.1f}" if limit else "-",
        f"{bare.p50:.1f}" if bare else "-",
        f"{worst:.1f}",
        f"{worst / limit:.3f}" if limit else "-",
        f"{worst / bare.p50:.3f}" if bare else "-",
        f"{result.early}, {result.overlapping}",
        f"{result.load_before:.1f}-{result.load_after:.1f}",
    )


def _own(result: Result) -> tuple[str, ...]:
    return (
        result.case,
        _pair(result.inputs),
        f"{result.inputs_expected:.1f}" if result.inputs_expected else "-",
        _pair(result.command_to_wire),
        _pair(result.command_to_verdict),
        _pair(result.foreign),
        f"{result.start:.0f} ({result.limit_start:.0f})",
        f"{result.plain_cpu:.0f}, {result.cpu:.0f}",
        f"{result.rss_mb:.1f}",
    )


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> Iterator[str]:
    yield f"| {' | '.join(head)} |"
    yield "|" + "---|" * len(head)
    for cells in rows:
        yield f"| {' | '.join(cells)} |"


def _pair(spread: Spread | None) -> str:
    return f"{spread.p50:.1f} / {spread.p99:.1f}" if spread else "-"


def _both(spread: Spread | None) -> str:
    return f"{_number(spread.p50)}/{_number(spread.p99)}" if spread else "-"


def _number(value: float) -> str:
    return f"{value:.1f}" if value >= 10 else f"{value:.2f}"
