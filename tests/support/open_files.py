"""The number of descriptors of this process: a leak shows as growth."""

from pathlib import Path


def open_files() -> int:
    """Counts them."""
    return sum(1 for _ in Path("/proc/self/fd").iterdir())
