"""Asks before a permanent write to a module."""

import sys

from bridge.cli.frame.usage import UsageError


def confirmed(question: str, *, yes: bool) -> bool:
    """Return whether the write is allowed: by `--yes`, or by the user at the terminal.

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
    print("nothing is written", file=sys.stderr)
    return False
