"""Output for a person at a terminal: a table, and a progress bar with the time left.

rich (the extra `cli`) makes them look better; without it, and without a terminal, they are plain
text.
"""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TextIO

Tell = Callable[[float, str], None]  # the time left in seconds, and the present step

_PAUSE_S = 0.1  # between two updates of the plain bar
_BAR_CHARS = 24


def print_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows to stdout, with a header if it is a terminal."""
    if not sys.stdout.isatty():
        print_columns(rows)
    elif not _rich_table(header, rows):
        print_columns([header, *rows])


def print_columns(rows: Sequence[Sequence[str]]) -> None:
    """Print rows in columns with two blanks between them."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print(
            "  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
        )


@contextmanager
def progress(total_s: float) -> Iterator[Tell]:
    """Show the progress on stderr while that is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _left_s, _text: None
        return
    try:
        from rich.console import Console  # noqa: PLC0415  # an extra, and only here
        from rich.progress import BarColumn, Progress, TextColumn  # noqa: PLC0415
    except ImportError:
        with _plain_bar(total_s, sys.stderr) as tell:
            yield tell
        return
    columns = (BarColumn(), TextColumn("{task.fields[left]}"), TextColumn("{task.description}"))
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, redirect_stdout=False) as shown:
        task = shown.add_task("", total=total_s, left="")

        def tell(left_s: float, text: str) -> None:
            shown.update(
                task, completed=total_s - left_s, left=left_words(left_s), description=text
            )

        yield tell


def left_words(left_s: float) -> str:
    """Return the time left, in words."""
    minutes, seconds = divmod(round(max(0.0, left_s)), 60)
    return f"{minutes}:{seconds:02} left"


@contextmanager
def _plain_bar(total_s: float, stream: TextIO) -> Iterator[Tell]:
    shown_at = 0.0

    def tell(left_s: float, text: str) -> None:
        nonlocal shown_at
        if time.monotonic() - shown_at < _PAUSE_S:
            return
        shown_at = time.monotonic()
        done = 1 - max(0.0, left_s) / total_s if total_s else 1.0
        bar = ("#" * round(done * _BAR_CHARS)).ljust(_BAR_CHARS, ".")
        stream.write(f"\r\x1b[K[{bar}] {left_words(left_s)}  {text}")
        stream.flush()

    try:
        yield tell
    finally:
        stream.write("\r\x1b[K")
        stream.flush()


def _rich_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> bool:
    """Print the table with rich; return False if rich is not installed."""
    try:
        from rich.console import Console  # noqa: PLC0415  # an extra, and only here
        from rich.table import Table  # noqa: PLC0415
        from rich.text import Text  # noqa: PLC0415
    except ImportError:
        return False
    table = Table(*header)
    for row in rows:
        table.add_row(*map(Text, row))  # as they are: a name may contain brackets
    Console().print(table)
    return True
