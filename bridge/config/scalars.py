"""Numbers, booleans and fixed words: the key decides how the text of a node is read."""

import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from decimal import Decimal

from bridge.config.nodes import Place, Reader, T, WrongValueError, is_plain, nearest, scalar
from bridge.config.text import text

# docs/failures.md A10: one YAML reader takes `010` as 8, another as 10, so it is refused here.
_WHOLE = re.compile(r"0|[1-9][0-9]{0,17}")
_NUMBER = re.compile(r"(?:0|[1-9][0-9]{0,17})(?:\.[0-9]{1,9})?")

# Words that are booleans in other programs, and what to write instead.
_BOOLEANS = {
    **dict.fromkeys(("true", "yes", "on", "y", "1"), "true"),
    **dict.fromkeys(("false", "no", "off", "n", "0"), "false"),
}


def whole(least: int, most: int) -> Reader[int]:
    """Return a reader of plain decimal numbers from `least` to `most`."""
    return _whole_in(range(least, most + 1), f"a whole number from {least} to {most}")


def one_of(numbers: Collection[int]) -> Reader[int]:
    """Return a reader of plain decimal numbers from a short list."""
    return _whole_in(numbers, f"one of {', '.join(map(str, numbers))}")


def _whole_in(allowed: Collection[int], wanted: str) -> Reader[int]:
    def read(place: Place) -> int:
        written = _unquoted(place, _WHOLE)
        if written is None:
            advice = _meant(scalar(place).value, allowed) or wanted
            raise WrongValueError(f"{place.shown} is not a plain decimal number; write {advice}")
        if int(written) not in allowed:
            raise WrongValueError(f"{written} is out of range; write {wanted}")
        return int(written)

    return read


def positive_number(most: int) -> Reader[float]:
    """Return a reader of numbers above 0, with or without decimals."""
    exact = positive_decimal(most)
    return lambda place: float(exact(place))


def positive_decimal(most: int) -> Reader[Decimal]:
    """Return a reader of numbers above 0 that keeps all decimals as written."""

    def read(place: Place) -> Decimal:
        written = _unquoted(place, _NUMBER)
        if written is None or not 0 < Decimal(written) <= most:
            raise WrongValueError(
                f"{place.shown} is not a plain decimal number above 0 and up to {most}; "
                "write one, such as 20 or 0.5"
            )
        return Decimal(written)

    return read


def boolean(place: Place) -> bool:
    """Read `true` or `false`, and no other word."""
    node = scalar(place)
    word: str = node.value
    if is_plain(node) and word in {"true", "false"}:
        return word == "true"
    advice = _BOOLEANS.get(word.lower(), "true or false")
    raise WrongValueError(f"{place.shown} is not a boolean; write {advice}")


def choice(options: Mapping[str, T]) -> Reader[T]:
    """Return a reader of fixed words, each with its value."""

    def read(place: Place) -> T:
        word = text(place)
        if word not in options:
            advice = f"write one of {', '.join(options)}"
            meant = nearest(word, options)
            hint = f" (did you mean {meant}?)" if meant else ""
            raise WrongValueError(f"{place.shown} is not known here; {advice}{hint}")
        return options[word]

    return read


def _unquoted(place: Place, pattern: re.Pattern[str]) -> str | None:
    node = scalar(place)
    return str(node.value) if is_plain(node) and pattern.fullmatch(node.value) else None


def _meant(written: str, allowed: Collection[int]) -> str:
    """Return the allowed numbers that other readers might take `written` for, in words."""
    # Base 0 is that of Python source: it knows 0x10, 0o10 and 0b10.
    bases = (10, 8, 0) if written.startswith("0") else (10,)
    found = []
    for base in bases:
        with suppress(ValueError):
            found.append(int(written, base))
    return " or ".join(str(number) for number in dict.fromkeys(found) if number in allowed)
