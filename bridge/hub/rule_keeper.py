"""Keeps over a restart which rules are switched off: `{"off": ["stairs"]}`."""

import json
import logging
import time
from pathlib import Path

from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.config.current import CurrentConfig
from bridge.files import read_file, replace_file
from bridge.hub.file_writer import FileWriter
from bridge.hub.memory import Memory

_log = logging.getLogger(__name__)

EVERY_S = 10.0  # at most: a switch that is turned all the time wears out no card
_MOST_BYTES = 1_000_000


class RuleKeeper:
    """Reads the file at the start, and writes changes. Only the main thread uses it.

    Where no rule was switched nothing is written. If the file is there and cannot be read, all
    rules are off: one that was switched off must not act again.
    """

    def __init__(
        self, current: CurrentConfig, memory: Memory, *, budgets: Budgets | None = None
    ) -> None:
        """Create it; `budgets` limit its log lines."""
        self._bounded = BoundedLog(_log, time.monotonic, budgets)
        self._current = current
        self._memory = memory
        self._writer = FileWriter("switches of rules", self._bounded)
        self._kept = (self._path, memory.rules_off)  # which file has what
        self._write_at = 0.0

    def open(self) -> None:
        """Load what an earlier process kept, once in this one."""
        if self._memory.rules_known:
            return
        self._memory.rules_known = True
        try:
            self._memory.rules_off = _read(self._path)
            self._kept = (self._path, self._memory.rules_off)
        except FileNotFoundError:
            return
        except (OSError, ValueError) as error:
            self._memory.rules_off = frozenset(rule.id for rule in self._current.config.rules)
            text = (
                f"{self._path} cannot be used ({error}), so it is not known which rules are "
                "switched off: all are off until each is switched on"
            )
            self._bounded.tell(Cause.DISK, "rules", logging.ERROR, text)

    def tick(self, now: float) -> None:
        """Start a write if a rule was switched."""
        if now >= self._write_at and self._lacks:
            self._write_at = now + EVERY_S
            self._write()

    def close(self, timeout_s: float) -> None:
        """Write what was switched last; wait for it."""
        self._writer.close(self._path, timeout_s, self._write)

    @property
    def _lacks(self) -> bool:
        off = self._memory.rules_off
        return (self._path, off) != self._kept and bool(off or self._kept[1])

    @property
    def _path(self) -> Path:
        return self._current.config.state_file("rules")

    def _write(self) -> None:
        if self._writer.is_busy or not self._lacks:
            return
        path, off = self._path, self._memory.rules_off
        data = json.dumps({"off": sorted(off)}).encode() + b"\n"

        def written() -> None:
            self._kept = (path, off)

        self._writer.start(path, lambda: replace_file(path, data), written)


def _read(path: Path) -> frozenset[str]:
    """Return the ids in the file.

    Raises:
        OSError: It cannot be read, or does not exist.
        ValueError: It is damaged.
    """
    try:
        document = json.loads(read_file(path, _MOST_BYTES))
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    off = document.get("off") if isinstance(document, dict) else None
    if not isinstance(off, list) or not all(isinstance(one, str) for one in off):
        raise ValueError("it has no list of rules that are off")
    return frozenset(off)
