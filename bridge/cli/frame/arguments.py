"""Arguments that several commands take, read for argparse."""

import argparse
from collections.abc import Callable

from bridge.commission.survey import parse_stations
from bridge.config.durations import parse_duration


def duration(example: str) -> Callable[[str], float]:
    """Return a reader of a time in seconds; `example` is shown when the text is none."""

    def read(text: str) -> float:
        try:
            return float(parse_duration(text))
        except ValueError:
            raise argparse.ArgumentTypeError(
                f"{text!r} is no time: write a number and its unit, such as {example}"
            ) from None

    return read


def addresses(text: str) -> tuple[int, ...]:
    """Return the addresses in a text such as `1-8,12`."""
    try:
        return parse_stations(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
