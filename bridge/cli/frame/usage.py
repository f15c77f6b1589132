"""Wrong usage of the command line: one line on stderr and exit status 2."""

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NoReturn

from bridge.config.schema import Config
from bridge.errors import BridgeError

_COLUMNS = 80  # where there is no terminal
EX_USAGE = 2  # the exit status of argparse, and of docs/contract.md for wrong usage


class UsageError(BridgeError):
    """Arguments that argparse accepted and that make no sense together: exit 2, one line."""


def actions_of(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """Return the declared arguments: options, and words, which have no option strings."""
    return parser._actions  # noqa: SLF001  # argparse has no public way to read it back


def synopsis_of(parser: argparse.ArgumentParser) -> str:
    """Return the usage in one line: the words in their order, and `[options]`."""
    words = [_shown(action) for action in actions_of(parser) if not action.option_strings]
    return " ".join(["%(prog)s", *words, "[options]"])


def _shown(word: argparse.Action) -> str:
    name = str(word.metavar or f"{{{','.join(word.choices or ())}}}")
    return f"[{name} ...]" if word.nargs == "*" and not name.startswith("[") else name


class Paragraphs(argparse.HelpFormatter):
    """Formats the paragraphs of a text; those with line breaks, as in examples, stay unchanged."""

    def __init__(self, prog: str) -> None:
        # Without a width argparse imports shutil, which brings three libraries of compression: one
        # is made for each argument, also in the daemon.
        super().__init__(prog, width=_columns() - 2)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = text.split("\n\n")
        return "\n\n".join(
            one if "\n" in one else super(Paragraphs, self)._fill_text(one, width, indent)
            for one in paragraphs
        )


def _columns() -> int:
    with suppress(KeyError, ValueError):
        if (given := int(os.environ["COLUMNS"])) > 0:
            return given
    with suppress(OSError, ValueError, AttributeError):  # it is closed, or there is none
        return os.get_terminal_size(sys.stdout.fileno()).columns or _COLUMNS
    return _COLUMNS


class OneLineParser(argparse.ArgumentParser):
    """An argument parser whose errors are one line: what, where and what to do."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, formatter_class=Paragraphs, **settings)

    def error(self, message: str) -> NoReturn:
        """Exit with one line; argparse would print the usage, often several lines, before it."""
        self.exit(EX_USAGE, f"{self.prog}: {message} (see {self.prog} --help)\n")


def check_stations(station_ids: Sequence[str], config: Config) -> None:
    """Refuse a station that the configuration does not have.

    Raises:
        UsageError: There is no such station.
    """
    known = [station_config.id for _, station_config in config.all_stations]
    for station_id in station_ids:
        if station_id not in known:
            raise UsageError(f"there is no station {station_id}; there are: {', '.join(known)}")
