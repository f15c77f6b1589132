"""The serial ports of this machine, for a person to choose from. Nothing is opened."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_PATTERNS = ("ttyUSB*", "ttyACM*", "ttyCH343USB*", "ttyXRUSB*", "ttyAMA*", "ttySC*", "ttymxc*")
_FRAME = re.compile(r"^usb-|-if[0-9]{2}(-port[0-9]+)?$")


@dataclass(frozen=True, slots=True)
class FoundPort:
    """A port, and the words that its adapter has for itself."""

    path: str
    words: str


def serial_ports(root: Path = Path("/dev")) -> list[FoundPort]:
    """Return the ports, those with a name that stays first."""
    return list(_ports(root))


def _ports(root: Path) -> Iterator[FoundPort]:
    named: set[str] = set()
    for link in sorted((root / "serial/by-id").glob("*")):
        named.add(os.path.realpath(link))
        yield FoundPort(str(link), _FRAME.sub("", link.name).replace("_", " "))
    for pattern in _PATTERNS:
        for device in sorted(root.glob(pattern)):
            if os.path.realpath(device) not in named:
                yield FoundPort(str(device), device.name)
