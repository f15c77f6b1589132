"""Reloads of every kind, and suspends of the machine."""

import random
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

from proofs.shifted_daemon import write_shifts

from soak.configuration import Configuration
from soak.house import HOMES, LINES, stations_on
from soak.ledger import Ledger

# The lines have to come to their end, and begin anew, before the next one.
RELOAD_EVERY_S = 12.0
SUSPEND_S = (5.0, 60.0)

# Name, how long it lasts, what undoes it, and the stations that suffer by it.
Start = Callable[[str, tuple[float, float], Callable[[], None], Iterable[str]], None]


class Upkeep:
    """One thread calls it.

    Attributes:
        line_starts: How often each line began anew.
    """

    def __init__(
        self,
        configuration: Configuration,
        ledger: Ledger,
        shifts: Path,
        send_signal: Callable[[signal.Signals], None],
        chance: random.Random,
    ) -> None:
        self.line_starts: Counter[str] = Counter()
        self._configuration = configuration
        self._ledger = ledger
        self._shifts = shifts
        self._send_signal = send_signal
        self._chance = chance
        self._shifted_s = 0.0
        self._asleep = False
        self._reload_at = 0.0

    def anew(self, lines: Iterable[str]) -> None:
        """These lines are told to end, and begin anew."""
        for line in lines:
            self._ledger.disturbances.began_anew(stations_on(line), time.monotonic())
            self.line_starts[line] += 1

    def reload(self, start: Start) -> None:
        """SIGHUP: for a line that changed, for another client, for nothing, for a bad file."""
        if time.monotonic() < self._reload_at:
            return
        self._reload_at = time.monotonic() + RELOAD_EVERY_S
        kinds = (self._change_line, self._change_line, self._change_client, self._no_change)
        self._chance.choice((*kinds, self._spoil))(start)
        self._send_signal(signal.SIGHUP)

    def suspend(self, start: Start) -> None:
        """The machine sleeps: nothing runs, and the clock that counts it goes on."""
        if self._asleep:
            return
        self._asleep = True
        self._send_signal(signal.SIGSTOP)
        start("suspend", (0.3, 2.0), self._wake, [home.id for home in HOMES])

    # --- the inside ---------------------------------------------------------------------------

    def _wake(self) -> None:
        slept_s = self._chance.uniform(*SUSPEND_S)
        self._shifted_s += slept_s
        write_shifts(self._shifts, self._shifted_s, 0.0)
        self._ledger.woke(time.monotonic(), slept_s)
        self._send_signal(signal.SIGCONT)
        self._asleep = False

    def _change_line(self, start: Start) -> None:
        line = self._chance.choice(list(LINES))
        self._configuration.change_line(line, self._chance)
        self.anew([line])
        start("reload: a line changed", (0.0, 0.0), _nothing, ())

    def _change_client(self, start: Start) -> None:
        self._configuration.change_client()
        self.anew(LINES)
        self._ledger.link.broken(time.monotonic())
        start("reload: another client", (RELOAD_EVERY_S, RELOAD_EVERY_S), self._mend, ())

    def _no_change(self, start: Start) -> None:
        start("reload: nothing changed", (0.0, 0.0), _nothing, ())

    def _spoil(self, start: Start) -> None:
        self._configuration.spoil()
        start("reload: a bad file", (0.5, 2.0), self._configuration.write, ())

    def _mend(self) -> None:
        self._ledger.link.mended(time.monotonic())


def _nothing() -> None:
    """Nothing is to be undone."""
