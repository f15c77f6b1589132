"""Counters of faults at the broker."""

from dataclasses import dataclass


@dataclass(slots=True)
class Counters:
    """Faults since the start. Only the thread of the client writes them."""

    connections: int = 0
    taken_over: int = 0
    failed_publishes: int = 0
    undecodable_topics: int = 0
