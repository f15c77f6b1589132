"""Asks every station of a survey, and keeps the findings. It only reads."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from bridge.clock import boot_s
from bridge.commission.asker import Asker
from bridge.commission.examine import look
from bridge.commission.findings import Finding, Findings
from bridge.commission.survey import ScanPlan, ScanSweep
from bridge.transport.port import Port


@dataclass(frozen=True, slots=True)
class ScanStep:
    """The progress of a scan.

    Attributes:
        round: From 1 on: a silent station is asked once in each round.
        left_s: The remaining time if no other module answers.
    """

    round: int
    rounds: int
    sweep: ScanSweep
    address: int
    left_s: float
    total_s: float


class Scan:
    """One scan of one port. Used once, by one thread.

    Attributes:
        findings: The findings so far.
        least_s: The part of the time so far that the wire and the time-outs need.
        took_s: The time so far.
    """

    def __init__(
        self,
        survey: ScanPlan,
        open_port: Callable[[int], Port],
        tell: Callable[[ScanStep | Finding], None],
        clock: Callable[[], float] = boot_s,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.findings = Findings()
        self.least_s = 0.0
        self.took_s = 0.0
        self._survey = survey
        self._open_port = open_port
        self._tell = tell
        self._clock = clock
        self._sleep = sleep
        self._port: Port | None = None
        self._baud = 0
        self._echo: bool | None = None
        self._left_s = survey.total_s

    def run(self, expect: int | None = None) -> None:
        """Scan until everything was asked, or until `expect` modules are found.

        Raises:
            PortError: The port is gone, or cannot be opened. The findings so far are kept.
        """
        began = self._clock()
        try:
            for turn, sweep in self._turns():
                if self._is_enough(expect):
                    return
                self._sweep(turn, sweep, expect)
        finally:
            self.took_s = self._clock() - began
            if self._port is not None:
                self._port.close()

    def _turns(self) -> Iterator[tuple[int, ScanSweep]]:
        for turn in range(1, self._survey.effort.tries + 1):
            for sweep in self._survey.sweeps:
                yield turn, sweep

    def _is_enough(self, expect: int | None) -> bool:
        return expect is not None and len(self.findings.found) >= expect

    def _sweep(self, turn: int, sweep: ScanSweep, expect: int | None) -> None:
        line = Asker(
            self._port_at(sweep.baud),
            self._survey.timing(sweep),
            echo=self._echo,
            clock=self._clock,
            sleep=self._sleep,
        )
        try:
            for address in sweep.addresses:
                if self._is_enough(expect):
                    return
                self._tell_step(turn, sweep, address)
                if not self.findings.is_known(address, sweep.baud, sweep.protocol):
                    for finding in look(line, sweep.baud, sweep.protocol, address):
                        self._note(finding)
                self._left_s -= self._survey.silent_s(sweep)
        finally:
            self.least_s += line.least_s
            self._echo = line.echo

    def _port_at(self, baud: int) -> Port:
        """Return the open port; open it again if it needs another baud rate."""
        if self._port is None or self._baud != baud:
            if self._port is not None:
                self._port.close()
            self._port, self._baud = self._open_port(baud), baud
        return self._port

    def _tell_step(self, turn: int, sweep: ScanSweep, address: int) -> None:
        total_s, rounds = self._survey.total_s, self._survey.effort.tries
        self._tell(ScanStep(turn, rounds, sweep, address, self._left_s, total_s))

    def _note(self, finding: Finding) -> None:
        if self.findings.add(finding):
            self._tell(finding)
