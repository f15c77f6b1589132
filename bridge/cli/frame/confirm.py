"""Asks before something is done for good."""

import sys

from bridge.cli.frame.usage import UsageError


def confirmed(question: str, *, yes: bool, otherwise: str = "nothing is written") -> bool:
    """Return whether it may be done: `--yes` said so, or the person at the terminal does.

    `otherwise` is said where the person says no.

    Raises:
        UsageError: There is no terminal to ask at.
    """
    if yes:
        return True
    if not sys.stdin.isatty():
        raise UsageError("there is no one to ask at a terminal: add --yes")
    print(f"{question} [y/N] ", end="", file=sys.stderr, flush=True)
    if sys.stdin.readline().strip().lower() in {"y", "yes"}:
        return True
    print(otherwise, file=sys.stderr)
    return False
