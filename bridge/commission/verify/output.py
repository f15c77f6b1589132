"""Switches one output that its owner named, to see what pulses do. Nothing else here writes."""

from collections.abc import Iterator

from bridge.commission.verify.assumptions import Finding, as_assumed, differs, not_tried
from bridge.commission.verify.talk import Talk
from bridge.drivers.modbus import ModbusDriver
from bridge.errors import ExchangeError
from bridge.model import OutputSettings, bit

NAMES = ("second-on", "off-in-pulse", "hold-time")
_TRIES = 3
_SHORTEST_S = 0.3  # of a hold time in which there is time to order and to look
_SPARE_S = 2.0
_APART_S = 0.2  # two looks further apart do not tell when it ended
_EXACT_S = 0.1  # registers count in tenths of a second


class _TrialError(Exception):
    """An order or a read was lost: the trial says nothing, and is made again."""


def output_findings(talk: Talk, output: int) -> Iterator[Finding]:
    """Try what only a pulse shows. The output is OFF at the end, or the module does not answer."""
    if not talk.takes_modbus:
        yield from _none("its mode cannot be read")
        return
    driver = ModbusDriver(talk.address, talk.model, talk.protocol.in_modbus)
    trial = _OutputTrial(talk, driver, output)
    settings, is_on = trial.settings(), trial.look()
    if settings is None or is_on is None:
        yield from _none("its mode, or its state, could not be read")
        return
    hold_s = settings.hold_ds[output - 1] / 10
    if not settings.pulse & bit(output):
        yield from _none(f"output {output} is a latch: name one in pulse mode")
    elif is_on:
        yield from _none(f"output {output} is ON already")
    elif hold_s < _SHORTEST_S:
        yield from _none(f"output {output} holds {hold_s:.1f} s: too short to see")
    else:
        yield from trial.run(hold_s)


def _none(why: str) -> Iterator[Finding]:
    return (not_tried(name, why) for name in NAMES)


class _OutputTrial:
    def __init__(self, talk: Talk, driver: ModbusDriver, output: int) -> None:
        self._talk = talk
        self._driver = driver
        self._output = output
        self._between_s = 0.0  # the two looks between which it last went OFF

    def settings(self) -> OutputSettings | None:
        """Read modes and hold times."""
        for _ in range(_TRIES + 1):
            try:
                return self._talk.line.exchange(self._driver.read_settings, protected=True)
            except ExchangeError:
                continue
        return None

    def look(self) -> bool | None:
        """Read the output; None: no answer."""
        for _ in range(_TRIES + 1):
            try:
                value = self._talk.line.exchange(self._driver.read_outputs, protected=True)
            except ExchangeError:
                continue
            return bool(value & bit(self._output))
        return None

    def run(self, hold_s: float) -> Iterator[Finding]:
        """Make the three trials, each again where an order was lost."""
        for name, trial in zip(NAMES, (self._second_on, self._off, self._hold), strict=True):
            for _ in range(_TRIES):
                try:
                    yield trial(hold_s)
                    break
                except _TrialError:
                    self._until_off(hold_s)
            else:
                yield not_tried(name, "orders were lost on the line")
            if self._until_off(hold_s) is None:
                self._order(False)

    def _second_on(self, hold_s: float) -> Finding:
        began = self._pulse()
        while self._talk.line.now() - began < hold_s / 2:
            self._seen()
        self._pulse()
        lasted_s = self._ended(2 * hold_s) - began
        restarts = lasted_s > 1.25 * hold_s
        word = "restarts" if restarts else "does not restart"
        return as_assumed("second-on", f"it {word} the hold time: {lasted_s:.1f} s in all")

    def _off(self, hold_s: float) -> Finding:
        began = self._pulse()
        if not self._order(False):
            raise _TrialError
        is_on = self._seen()
        if self._talk.line.sent_at - began > 0.8 * hold_s:
            raise _TrialError
        return (differs if is_on else as_assumed)(
            "off-in-pulse", "it goes on" if is_on else "it ends at once"
        )

    def _hold(self, hold_s: float) -> Finding:
        began = self._pulse()
        lasted_s = self._ended(hold_s) - began
        seen = f"{lasted_s:.2f} s, by its register {hold_s:.1f} s"
        exact = abs(lasted_s - hold_s) <= max(_EXACT_S, 0.05 * hold_s) + self._between_s / 2
        return (as_assumed if exact else differs)("hold-time", seen)

    def _pulse(self) -> float:
        """Order ON, once; return when."""
        if not self._order(True):
            raise _TrialError
        return self._talk.line.sent_at

    def _order(self, on: bool) -> bool:
        mask = bit(self._output)
        request = self._driver.write_outputs(mask, mask if on else 0, 0)
        try:
            self._talk.line.exchange(request, protected=True)
        except ExchangeError:
            return False
        return True

    def _seen(self) -> bool:
        is_on = self.look()
        if is_on is None:
            raise _TrialError
        return is_on

    def _ended(self, hold_s: float) -> float:
        """Wait until it is OFF, and return when."""
        ended = self._until_off(hold_s, exactly=True)
        if ended is None:
            raise _TrialError
        return ended

    def _until_off(self, hold_s: float, *, exactly: bool = False) -> float | None:
        """Wait until it is OFF; return when, between the two last looks; None: it was not."""
        line = self._talk.line
        before, until = line.sent_at, line.now() + hold_s + _SPARE_S
        while line.now() < until:
            is_on, at = self.look(), line.sent_at
            if is_on is False and at - before > _APART_S and exactly:
                raise _TrialError
            if is_on is False:
                self._between_s = at - before
                return (before + at) / 2
            if is_on:
                before = at
        return None
