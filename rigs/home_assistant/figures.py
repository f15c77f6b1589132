"""The measurements of the tests, printed at the end."""

from collections import defaultdict

_LINES: list[str] = []
_TIMES: dict[tuple[str, str], list[float]] = defaultdict(list)


def note(where: str, what: str) -> None:
    """Keeps one line."""
    _LINES.append(f"{where}: {what}")


def note_slowest(where: str, what: str, took_s: float) -> None:
    """Keeps one of several times, of which the largest is told."""
    _TIMES[where, what].append(took_s)


def told() -> list[str]:
    """Everything, a line each."""
    times = [
        f"{where}: the slowest of {len(took)}, {what}, was shown after {max(took) * 1000:.0f} ms"
        for (where, what), took in _TIMES.items()
    ]
    return sorted([*_LINES, *times])
