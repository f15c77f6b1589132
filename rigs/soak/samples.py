"""The size of a process: memory, descriptors, threads, objects."""

import os
import signal
import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import linear_regression

COUNT_PATIENCE_S = 10.0
# The least of the first and of the last third is compared. The memory of Python comes in arenas of
# 1 MiB, one of which comes and goes: a leak lifts the least value, an arena does not.
PARTS = 3


@dataclass(frozen=True, slots=True)
class Sample:
    """One look at the process, `at` seconds after the beginning; memory in KiB."""

    at: float
    rss: int
    pss: int
    dirty: int
    descriptors: int
    threads: int
    objects: int

    def __str__(self) -> str:
        return (
            f"{self.at / 60:5.1f} min  RSS {self.rss} KiB  Pss {self.pss}  dirty {self.dirty}  "
            f"descriptors {self.descriptors}  threads {self.threads}  objects {self.objects}"
        )


@dataclass(frozen=True, slots=True)
class Growth:
    """How much samples grew: by their least values, and as a slope by the hour."""

    by: float
    per_hour: float


def take(process: subprocess.Popen[bytes], count_file: Path, at: float) -> Sample:
    """Looks at a process that `counted_daemon` runs in."""
    proc = Path(f"/proc/{process.pid}")
    # Counting takes memory of its own for a moment, so it comes last.
    status = _numbers(proc / "status")
    memory = _numbers(proc / "smaps_rollup")
    descriptors = len(os.listdir(proc / "fd"))  # noqa: PTH208 - /proc holds no files to look at
    objects = _count(process, count_file)
    return Sample(
        at=at,
        rss=status["VmRSS"],
        pss=memory["Pss"],
        dirty=memory["Private_Dirty"],
        descriptors=descriptors,
        threads=status["Threads"],
        objects=objects,
    )


def growth(samples: Sequence[Sample], values: Sequence[int]) -> Growth:
    """Return how much `values`, of these samples, grew."""
    part = max(1, len(values) // PARTS)
    # Two thirds of the time lie between them.
    by = (min(values[-part:]) - min(values[:part])) * PARTS / (PARTS - 1)
    hours = [sample.at / 3600 for sample in samples]
    return Growth(by, linear_regression(hours, values).slope if len(values) > 1 else 0.0)


def cpu_s(process: subprocess.Popen[bytes]) -> float:
    """The processor time that it used so far."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _numbers(path: Path) -> dict[str, int]:
    """The lines `Name:  number ...` of a file of /proc."""
    found = {}
    for line in path.read_text().splitlines():
        name, _, rest = line.partition(":")
        if (words := rest.split()) and words[0].isdecimal():
            found[name] = int(words[0])
    return found


def _count(process: subprocess.Popen[bytes], count_file: Path) -> int:
    count_file.unlink(missing_ok=True)
    process.send_signal(signal.SIGUSR1)
    give_up = time.monotonic() + COUNT_PATIENCE_S
    while not count_file.exists():
        if time.monotonic() > give_up or process.poll() is not None:
            return -1  # a main thread that does not come to its signals: the report shows it
        time.sleep(0.01)
    return int(count_file.read_text())
