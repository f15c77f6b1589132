"""Keep the memory of the process small: one heap, and what is free goes back to the system."""

import ctypes

_M_ARENA_MAX = -8  # of glibc's malloc.h


def share_heap() -> None:
    """Let all threads use one heap, before there are any; do nothing on musl, where they do.

    Each would keep some 100 KiB free of its own, and Python lets one at a time run anyway.
    """
    set_option = getattr(ctypes.CDLL(None), "mallopt", None)
    if set_option is not None:
        set_option(_M_ARENA_MAX, 1)


def trim_heap() -> None:
    """Return freed memory to the system; do nothing where the C library cannot (musl).

    A configuration that was read leaves 1.5 MB free between what is kept of it. Without this the
    next ones do not fit there, and the process grows by some 300 KiB at its first reloads. The
    announcements of 31 modules leave 1 MB.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
