"""Times with a unit: `50ms`, `0.5s`, `10min`."""

import re
from decimal import Decimal

from bridge.config.nodes import Place, Reader, T, WrongValueError, scalar
from bridge.model import HOLD_DS

_UNITS = {"ms": Decimal("0.001"), "s": Decimal(1), "min": Decimal(60)}
_DURATION = re.compile(r"((?:0|[1-9][0-9]{0,8})(?:\.[0-9]{1,20})?)(ms|s|min)")
_PLAIN_SECONDS = re.compile(r"[0-9]{1,2}(\.[0-9]{1,20})?")
_TINY = 1e-9  # rounding of decimals in other programs: 0.1 + 0.2 is 0.30000000000000004


def parse_duration(text: str) -> Decimal:
    """Return a duration in seconds, exactly. Zero needs no unit.

    Raises:
        ValueError: It is not a duration.
    """
    if text == "0":
        return Decimal(0)
    match = _DURATION.fullmatch(text)
    if match is None:
        raise ValueError(text)
    return Decimal(match[1]) * _UNITS[match[2]]


def plain_seconds(text: str) -> float | None:
    """Return seconds without a unit, such as `2.5`; None: it is not such a number."""
    return float(text) if _PLAIN_SECONDS.fullmatch(text) else None


def tenths(seconds: float | Decimal) -> int | None:
    """Return a time in tenths of a second; None if it is not a whole number of them."""
    if not 0 <= seconds < 10 * len(HOLD_DS):  # NaN fails every comparison
        return None
    count = round(10 * seconds)
    return count if abs(10 * float(seconds) - count) < _TINY else None


def duration(least: str, most: str) -> Reader[float]:
    """Return a reader of durations from `least` to `most`."""

    def read(place: Place) -> float:
        return float(_between(place, least, most))

    return read


def hold_time(place: Place) -> float:
    """Read a hold time, which a register holds as 1 to 255 tenths (docs/protocol.md section 3)."""
    seconds = _seconds(place)
    count = tenths(seconds)
    _check_range(place, seconds if count is None else Decimal(count) / 10, "0.1s", "25.5s")
    if count is None:
        raise WrongValueError(
            f"{place.shown} is not in steps of 0.1s; the module counts in tenths of a second"
        )
    return count / 10


def auto_or(reader: Reader[T]) -> Reader[T | None]:
    """Return a reader that also takes the word `auto`, which it returns as None."""

    def read(place: Place) -> T | None:
        return None if scalar(place).value == "auto" else reader(place)

    return read


def _between(place: Place, least: str, most: str) -> Decimal:
    seconds = _seconds(place)
    _check_range(place, seconds, least, most)
    return seconds


def _seconds(place: Place) -> Decimal:
    try:
        return parse_duration(scalar(place).value)
    except ValueError:
        raise WrongValueError(
            f"{place.shown} is not a duration; "
            "write a number and its unit (ms, s or min) without a space, such as 50ms"
        ) from None


def _check_range(place: Place, seconds: Decimal, least: str, most: str) -> None:
    if not parse_duration(least) <= seconds <= parse_duration(most):
        raise WrongValueError(f"{place.shown} is out of range; write {least} to {most}")
