"""Times as people write them: a number and its unit, `50ms`, `0.5s`, `10min`."""

import re
from decimal import Decimal

from bridge.config.nodes import Place, Reader, T, WrongValueError, scalar

_UNITS = {"ms": Decimal("0.001"), "s": Decimal(1), "min": Decimal(60)}
_DURATION = re.compile(r"((?:0|[1-9][0-9]{0,8})(?:\.[0-9]{1,6})?)(ms|s|min)")


def parse_duration(text: str) -> Decimal:
    """Reads a duration in seconds, exactly. Zero needs no unit.

    Raises:
        ValueError: It is no duration.
    """
    if text == "0":
        return Decimal(0)
    match = _DURATION.fullmatch(text)
    if match is None:
        raise ValueError(text)
    return Decimal(match[1]) * _UNITS[match[2]]


def duration(least: str, most: str) -> Reader[float]:
    """Makes a reader of durations from `least` to `most`, in seconds."""

    def read(place: Place) -> float:
        return float(_between(place, least, most))

    return read


def hold_time(place: Place) -> float:
    """Reads a hold time, which a register holds as 1 to 255 tenths (PROTOCOL.md section 3)."""
    seconds = _between(place, "0.1s", "25.5s")
    if seconds * 10 % 1:
        raise WrongValueError(
            f"{place.shown} is not in steps of 0.1s; the module counts in tenths of a second"
        )
    return float(seconds)


def auto_or(reader: Reader[T]) -> Reader[T | None]:
    """Makes a reader that also takes the word `auto`, which it gives as None."""

    def read(place: Place) -> T | None:
        return None if scalar(place).value == "auto" else reader(place)

    return read


def _between(place: Place, least: str, most: str) -> Decimal:
    try:
        seconds = parse_duration(scalar(place).value)
    except ValueError:
        raise WrongValueError(
            f"{place.shown} is not a duration; "
            "write a number and its unit (ms, s or min) without a space, such as 50ms"
        ) from None
    if not parse_duration(least) <= seconds <= parse_duration(most):
        raise WrongValueError(f"{place.shown} is out of range; write {least} to {most}")
    return seconds
