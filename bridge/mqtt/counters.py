"""What went wrong at the broker, in numbers."""

from dataclasses import dataclass


@dataclass(slots=True)
class Counters:
    """Describe what went wrong since the start. The client's thread alone writes it."""

    connections: int = 0
    taken_over: int = 0
    failed_publishes: int = 0
    undecodable_topics: int = 0
