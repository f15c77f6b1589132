"""Tests of the memory that is given back."""

import ctypes
from pathlib import Path

import pytest

from bridge.daemon.heap import trim_heap

BLOCK = 4096


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
