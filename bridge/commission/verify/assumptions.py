"""What is assumed of the modules: each reading of docs/protocol.md by its id. A test keeps both.

Every code that names a reading takes its id from here.
"""

from dataclasses import dataclass
from enum import StrEnum


class FindingWord(StrEnum):
    """Describe what was found of one assumption."""

    AS_ASSUMED = "as assumed"
    DIFFERS = "differs"
    NOT_TRIED = "not tried"


@dataclass(frozen=True, slots=True)
class Assumption:
    """One reading.

    Attributes:
        taken: What the bridge takes, in a few words.
        relied: The bridge relies on it, so that a module that differs is a failure.
        untried: Why `verify` never tries it; empty: it does.
    """

    id: str
    taken: str
    relied: bool
    untried: str = ""


@dataclass(frozen=True, slots=True)
class Finding:
    """What one module was seen to do, or why it was not tried."""

    id: str
    word: FindingWord
    seen: str


_WEARS = "it would write to the EEPROM"

_ALL = (
    Assumption("err-end", "CR follows ERR=n", relied=True),
    Assumption("line-end", "CR alone ends a Wisco reply", relied=False),
    Assumption("hex-case", "hex digits are upper case", relied=False),
    Assumption("cheap-frames", "it takes the shortest reads of its protocol", relied=True),
    Assumption("ree-checksum", "the checksum of REE covers the data", relied=True),
    Assumption("wee-example", "the count of WEE is that of the data", relied=True, untried=_WEARS),
    Assumption("wee-longest", "no WEE over a page of 16 bytes", relied=False, untried=_WEARS),
    Assumption("register-bytes", "unknown where in the EEPROM registers are", relied=False),
    Assumption(
        "station-0",
        "Modbus never asks address 0",
        relied=False,
        untried="in Modbus, 0 is all modules: it is never asked",
    ),
    Assumption("fc02-on-do100", "a DO100 refuses to read inputs, with code 1", relied=True),
    Assumption("exceptions", "a wrong address is refused with code 2", relied=True),
    Assumption("second-on", "unknown whether a second ON restarts a pulse", relied=False),
    Assumption("off-in-pulse", "OFF ends a pulse", relied=True),
    Assumption("hold-time", "a pulse lasts as long as its register says", relied=False),
    Assumption(
        "mode-change", "unknown what a new mode does to an output", relied=False, untried=_WEARS
    ),
    Assumption("silence-before", "RTU 3.5 characters, else none", relied=True),
    Assumption("turnaround", "a reply begins within the turnaround of the line", relied=True),
    Assumption("late-reply", "no reply comes after the late window", relied=True),
    Assumption("switch-8", "Wisco and Modbus ASCII are answered both", relied=False),
    Assumption(
        "power-up",
        "unknown, and met by reads",
        relied=False,
        untried="a person has to switch the module off and on",
    ),
    Assumption(
        "broadcast",
        "never sent",
        relied=False,
        untried="it would write to every module of the line",
    ),
)
ASSUMPTIONS = {one.id: one for one in _ALL}


def as_assumed(name: str, seen: str) -> Finding:
    """Return that a module does what is assumed."""
    return Finding(name, FindingWord.AS_ASSUMED, seen)


def differs(name: str, seen: str) -> Finding:
    """Return that a module does something else."""
    return Finding(name, FindingWord.DIFFERS, seen)


def not_tried(name: str, why: str) -> Finding:
    """Return that it was not tried, or came to nothing."""
    return Finding(name, FindingWord.NOT_TRIED, why)
