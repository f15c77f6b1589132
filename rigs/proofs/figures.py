"""What a proof is: an id, a failure that is injected, and what was seen against the promise."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path


class Scale(Enum):
    """How much is injected: a little in each `make test`, all of it in `make proofs`."""

    SHORT = "short"
    FULL = "full"

    def of(self, short: int, full: int) -> int:
        """The count for this scale."""
        return full if self is Scale.FULL else short


@dataclass(frozen=True, slots=True)
class Figure:
    """What one proof saw.

    Attributes:
        injected: What was done to the bridge, with its count.
        seen: What came of it, with its count.
        promised: What was promised.
        kept: Whether that was seen.
    """

    injected: str
    seen: str
    promised: str
    kept: bool


@dataclass(frozen=True, slots=True)
class Run:
    """What a proof is given: how much to inject, and an empty directory."""

    scale: Scale
    directory: Path


Proof = Callable[[Run], Figure]
PROOFS: dict[str, Proof] = {}  # by id, in the order of definition
NOT_HERE: dict[str, str] = {  # what takes real hardware
    "D4": "an adapter whose RTS is toggled by software; real hardware",
}


def proof(identity: str) -> Callable[[Proof], Proof]:
    """Enters a function as the proof of one id, such as A5."""

    def enter(function: Proof) -> Proof:
        assert identity not in PROOFS, identity
        PROOFS[identity] = function
        return function

    return enter
