"""Wrong usage of the command line: one line on stderr and exit status 2."""

import argparse
from typing import NoReturn

from bridge.errors import BridgeError

EX_USAGE = 2  # what argparse exits with, and so CONTRACT.md's "wrong usage"


class UsageError(BridgeError):
    """Arguments that argparse took and that make no sense together: exit 2, one line."""


class OneLineParser(argparse.ArgumentParser):
    """An argument parser whose errors are one line: what, where and what to do."""

    def error(self, message: str) -> NoReturn:
        """Ends the process: argparse would print the usage, often several lines, before it."""
        self.exit(EX_USAGE, f"{self.prog}: {message} (see {self.prog} --help)\n")
