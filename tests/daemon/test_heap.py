"""Tests of the memory that is given back."""

import ctypes
import subprocess
import sys
from pathlib import Path

import pytest

from bridge.daemon.heap import trim_heap

BLOCK = 4096
# A thread with a heap of its own reserves 64 MiB of addresses for it.
COUNT_HEAPS = """
import sys, threading
from bridge.daemon.heap import share_heap
if sys.argv[1] == "shared":
    share_heap()
kept = []
thread = threading.Thread(target=lambda: kept.extend(bytes(4096) for _ in range(100)))
thread.start()
thread.join()
ranges = [line.split()[0] for line in open("/proc/self/maps") if " ---p " in line]
sizes = [int(end, 16) - int(start, 16) for start, end in (one.split("-") for one in ranges)]
print(sum(2**25 < size <= 2**26 for size in sizes))
"""


def rss_kib() -> int:
    """Return what this process holds in memory."""
    return int(Path("/proc/self/status").read_text().split("VmRSS:")[1].split()[0])


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="this is no glibc")
def test_memory_between_blocks_in_use_goes_back_to_the_system() -> None:
    """Of 32 MiB in blocks all but each 64th are freed: most of it is not held any more."""
    blocks = [bytes(BLOCK) for _ in range(8192)]
    kept = blocks[::64]
    full = rss_kib()
    del blocks
    trim_heap()
    assert full - rss_kib() > 16 * 1024
    assert len(kept) == 128


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="this is no glibc")
@pytest.mark.parametrize(("how", "heaps"), [("shared", 0), ("apart", 1)])
def test_threads_have_no_heaps_of_their_own(how: str, heaps: int) -> None:
    """Each would keep free memory; without the option there is one more for a thread."""
    command = [sys.executable, "-c", COUNT_HEAPS, how]
    found = subprocess.run(command, check=True, capture_output=True, text=True)
    assert int(found.stdout) == heaps
