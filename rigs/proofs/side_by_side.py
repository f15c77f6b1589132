"""Runs proofs in full, some at a time, each in a process of its own: most of them wait."""

import logging
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from proofs import everything
from proofs.figures import Figure, Run, Scale

# These take minutes each: they begin first, so that none of them is left to run alone.
LONGEST = ("H1", "G2", "C1", "A4", "B4", "C3", "A1", "C6", "B2", "B6", "E5", "A13", "F16")

Proved = tuple[Figure, float]


def proved(names: Sequence[str], jobs: int) -> Iterator[tuple[str, Figure, float]]:
    """Yields in their order what each saw, and how many seconds it took."""
    context = get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, max_tasks_per_child=1) as pool:
        futures = {name: pool.submit(prove, name) for name in sorted(names, key=_begins)}
        for name in names:
            yield name, *_outcome(futures[name])


def _begins(name: str) -> int:
    return LONGEST.index(name) if name in LONGEST else len(LONGEST)


def prove(name: str) -> Proved:
    """Runs one."""
    logging.getLogger().addHandler(logging.NullHandler())  # what is injected is no news here
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix=f"proof-{name}-") as directory:
        figure = everything.PROOFS[name](Run(Scale.FULL, Path(directory)))
    return figure, time.monotonic() - began


def _outcome(future: Future[Proved]) -> Proved:
    error = future.exception()
    if error is None:
        return future.result()
    # The others are to be seen all the same.
    traceback.print_exception(error)
    return Figure("", f"{type(error).__name__}: it did not come to an end", "", kept=False), 0.0
