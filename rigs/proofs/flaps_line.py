"""What can come and go on a line, made to: through a real line worker on a virtual line."""

from dataclasses import replace

from support.covers import SHUTTER, cover_station
from support.virtual_line import Fault
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import LineConfig, OutputConfig
from bridge.errors import PortError
from bridge.line.exchanger import Exchanger
from bridge.line.worker import LineWorker
from bridge.model import DIO100, DO100, LineProtocol, Setting, SettingCommand
from bridge.simulator.module import SimulatedModule
from proofs.flapping import Flap, Step

_LONGEST_DAWDLE_S = 1.0
_AWAY, _OTHER, _BY_HAND, _SET, _TIMED = range(1, 6)  # addresses
_MAX_ON_S = 0.2


class _Line(VirtualWorker):
    """A worker that works as often as what flaps can be seen, and keeps no records.

    Attributes:
        fails_with: What becomes of every exchange; None: nothing.
    """

    def __init__(self, flap: Flap, exchanges: int) -> None:
        """Args: `exchanges` are made in a period at the most."""
        timed = (OutputConfig(1, max_on_s=_MAX_ON_S), OutputConfig(2))
        declared = (OutputConfig(1, mode="latch"),)
        stations = [
            make_station(_AWAY),
            make_station(_OTHER),
            replace(make_station(_BY_HAND), interlock=(0b11,)),
            make_station(_SET, outputs=declared),
            make_station(_TIMED, outputs=timed),
        ]
        super().__init__(make_line(*stations, protocol=LineProtocol.MODBUS_RTU))
        self.fails_with: Fault | None = None
        self._flap = flap
        self._dawdle_s = min(flap.period_s / exchanges, _LONGEST_DAWDLE_S)
        flap.clock = self.line.clock
        self.line.fault = self._dawdle

    def alternate(self, begin: Step, end: Step) -> None:
        """See `Flap`: the worker works meanwhile."""

        def step(now: Step, then: Step) -> None:
            now()
            self.events.clear()
            self.measured.clear()
            self.line.wire.clear()
            self.line.opened.clear()
            again = self.line.now + self._flap.period_s / 2
            self.line.at(again, lambda: step(then, now))

        step(begin, end)
        self.run(self.line.now + self._flap.length_s)

    def _dawdle(self, _frame: bytes) -> Fault | None:
        self.line.advance(self.line.now + self._dawdle_s)
        return self.fails_with


def port(flap: Flap) -> None:
    """The adapter is pulled out and plugged in."""
    line = _Line(flap, 24)

    def pull() -> None:
        line.line.open_error = "no such device"
        line.fails_with = Fault.PORT_GONE

    def plug() -> None:
        line.line.open_error = None
        line.fails_with = None

    line.alternate(plug, pull)


def modules(flap: Flap) -> None:
    """Modules lose their supply, are exchanged, switched by hand and by max_on, set and set back.

    And another master speaks.
    """
    line = _Line(flap, 4)
    right = line.line.modules[_OTHER]
    wrong = SimulatedModule(DO100, _OTHER, clock=line.line.clock)

    def begin() -> None:
        line.line.modules[_AWAY].away = True
        line.line.modules[_OTHER] = wrong
        line.line.modules[_BY_HAND].set_output(1, True)
        line.line.modules[_BY_HAND].set_output(2, True)
        line.line.modules[_TIMED].set_output(1, True)
        line.line.counters.unsolicited_bytes += 12
        _set_mode(line, pulse=True)

    def end() -> None:
        line.line.modules[_AWAY].away = False
        line.line.modules[_OTHER] = right
        line.line.modules[_BY_HAND].set_output(1, False)
        line.line.modules[_BY_HAND].set_output(2, False)
        _set_mode(line, pulse=False)

    line.alternate(begin, end)


def _set_mode(line: VirtualWorker, *, pulse: bool) -> None:
    now = line.line.now
    word = "pulse" if pulse else "latch"
    command = SettingCommand(
        f"s{_SET}", "do/1/mode", word, 1, Setting.MODE, int(pulse), arrived=now, deadline=now + 2.0
    )
    line.worker.submit(command)


def motor(flap: Flap) -> None:
    """A line is ended again and again while its cover's motor cannot be stopped.

    The report alone: a whole stop each half a second would take hours.
    """
    config = cover_station(make_station(1, DIO100))
    worker = LineWorker(
        make_line(config), lambda _: None, _no_bus, flap.clock, budgets=flap.budgets
    )
    report, module = worker._report, worker._by_id["s1"]
    flap.alternate(lambda: report.cover_left(module, SHUTTER.id), lambda: None)


def _no_bus(_line: LineConfig) -> Exchanger:
    raise PortError("no such device")
