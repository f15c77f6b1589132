"""Keeps late replies away from a write, and a write close to the read that it builds upon.

A reply that was due before a write tells what was before it, and it fits each read after it: so it
passes first. What is written back beside what was asked for has to be as it was just read.
"""

from collections.abc import Callable
from typing import TypeVar

from bridge.engine.station import Exchanger

T = TypeVar("T")

_ROUNDS = 2  # so that a module of which much is lost does not hold its line


def read_fresh(
    bus: Exchanger, address: int, clock: Callable[[], float], read: Callable[[], T | None]
) -> T | None:
    """Reads so that a write to that station can follow at once.

    Returns:
        What `read` did, or None too where tries were lost each time, so that the write would have
        to wait for their late replies.
    """
    for _ in range(_ROUNDS):
        bus.let_pass(address)
        value = read()
        if value is None or bus.late_until(address) <= clock():
            return value
    return None


def goes_out_at(bus: Exchanger, address: int, clock: Callable[[], float]) -> float:
    """When a write to that station would go out, if it were begun now: the bus may have to wait."""
    return max(clock(), bus.quiet_until, bus.late_until(address))
