"""The parts of a proof: its id, the injected failure, and what was seen against the promise."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path


class Scale(Enum):
    """The amount of injections: few in `make test`, all of them in `make proofs`."""

    SHORT = "short"
    FULL = "full"

    def of(self, short: int, full: int) -> int:
        """The count for this scale."""
        return full if self is Scale.FULL else short


@dataclass(frozen=True, slots=True)
class Figure:
    """The result of one proof.

    Attributes:
        injected: The injected failure, with its count.
        seen: The observation, with its count.
        promised: The promise.
        kept: Whether the observation agrees with the promise.
    """

    injected: str
    seen: str
    promised: str
    kept: bool


@dataclass(frozen=True, slots=True)
class Run:
    """The input of a proof: its scale, and an empty directory."""

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
