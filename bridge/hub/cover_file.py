"""The file that keeps where covers stand over a restart of the bridge.

It is written at a stop and removed at the next start, so a bridge that was killed, with a motor
that may have run on, leaves none. After a boot of the machine, or a longer stop, a cover may have
moved unseen: then it is not believed.
"""

import json
import logging
import threading
from dataclasses import asdict
from pathlib import Path

from bridge.bounded_log import BoundedLog, Cause
from bridge.files import read_file
from bridge.line.rules.cover import CLOSED, OPEN
from bridge.model import StandingCover, StandingCovers

BELIEVED_S = 120.0  # a restart or an update; somebody may move a cover in a longer time
_WITHOUT = "the positions of covers are not known until they were at an end"
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
_MOST_BYTES = 1_000_000
_DAMAGED = (ValueError, RecursionError, KeyError, TypeError)


def keep_covers(
    path: Path, standing: StandingCovers, now: float, timeout_s: float, log: BoundedLog
) -> None:
    """Write the file, in a thread: a defective disk may not end. Nothing stands: no file.

    It is not flushed to the disk: after a power cut it would not be believed.
    """
    if standing:
        write = threading.Thread(
            target=_write, args=(path, standing, now, log), name="covers to disk", daemon=True
        )
        write.start()
        write.join(timeout_s)


def take_covers(path: Path, now: float, log: BoundedLog) -> StandingCovers:
    """Return where covers stood at the stop, and remove the file; empty if it is not believed."""
    try:
        data = read_file(path, _MOST_BYTES)
        path.unlink()  # one that stays would be believed again
        return _believed(json.loads(data), now)
    except FileNotFoundError:
        pass
    except OSError as error:
        _warn(log, f"{path} cannot be read and removed ({error}): {_WITHOUT}")
    except _DAMAGED as error:
        _warn(log, f"{path} is damaged ({error}): {_WITHOUT}")
    return ()


def _believed(document: dict[str, object], now: float) -> StandingCovers:
    at, covers = document["at"], document["covers"]
    if document["boot"] != _boot_id() or not isinstance(at, float) or not isinstance(covers, list):
        return ()
    if not 0 <= now - at <= BELIEVED_S:
        return ()
    return tuple(_cover(**one) for one in covers)


def _cover(
    *, address: int, station_id: str, cover: str, build: str, position: float
) -> StandingCover:
    if type(position) is not float or not CLOSED <= position <= OPEN:
        raise ValueError(f"{cover} has no position")
    return StandingCover(address, station_id, cover, build, position)


def _write(path: Path, standing: StandingCovers, now: float, log: BoundedLog) -> None:
    covers = [asdict(one) for one in standing]
    document = {"boot": _boot_id(), "at": float(now), "covers": covers}
    fresh = path.with_name(f"{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh.write_text(json.dumps(document))
        fresh.replace(path)
    except OSError as error:
        _warn(log, f"where covers stand cannot be written to {path}: {error}")


def _warn(log: BoundedLog, text: str) -> None:
    log.tell(Cause.DISK, "covers", logging.WARNING, text)


def _boot_id() -> str:
    return BOOT_ID.read_text().strip()
