"""Where a credential of systemd comes from, for commands that run beside the service.

`/run/credentials/UNIT/NAME` is there only while the service runs, and only root and the service
may look at it. It is a copy of what the unit's `LoadCredential=NAME:PATH` names (systemd.exec(5)).
"""

from collections.abc import Iterator
from pathlib import Path

FOLDER = Path("/run/credentials")
# systemd.unit(5): a unit in an earlier folder hides one of that name in a later one.
UNIT_FOLDERS = (
    Path("/etc/systemd/system"),
    Path("/run/systemd/system"),
    Path("/usr/local/lib/systemd/system"),
    Path("/usr/lib/systemd/system"),
)
_KEY = "LoadCredential="


def is_credential(path: Path) -> bool:
    """Return whether a path names a credential that systemd hands over."""
    return len(path.parts) == len(FOLDER.parts) + 2 and path.is_relative_to(FOLDER)


def source_of(credential: Path) -> Path | None:
    """Return the file that a credential is a copy of; None: no unit that can be read says so."""
    unit, name = credential.parts[-2:]
    source = None
    for line in _lines(unit):
        if line.startswith(_KEY):
            written, _, path = line.removeprefix(_KEY).strip().partition(":")
            if not written or written == name:  # an empty one takes back those before it
                source = Path(path) if path.startswith("/") else None
    return source


def _lines(unit: str) -> Iterator[str]:
    """Yield the lines of a unit and of its drop-ins, in the order in which they count."""
    units = (folder / unit for folder in UNIT_FOLDERS)
    drop_ins = {
        path.name: path
        for folder in reversed(UNIT_FOLDERS)
        for path in (folder / f"{unit}.d").glob("*.conf")
    }
    first = next((path for path in units if path.is_file()), None)
    for path in (*([first] if first else []), *(drop_ins[name] for name in sorted(drop_ins))):
        try:
            yield from path.read_text(errors="replace").splitlines()
        except OSError:
            continue
