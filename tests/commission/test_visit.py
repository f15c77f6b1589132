"""Meeting one station for a command that asks once, in virtual time."""

import pytest
from support.virtual_line import Fault, VirtualLine
from support.virtual_worker import make_line, make_station

from bridge.commission.visit import NotMetError, meet
from bridge.errors import PortError
from bridge.line.station import Station
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.module import SimulatedModule


class Panel:
    """One configured station, and the line that it is on."""

    def __init__(self, protocol: LineProtocol = LineProtocol.MODBUS_RTU) -> None:
        self.config = make_line(make_station(1, DIO100), protocol=protocol)
        self.line = VirtualLine(self.config)
        self.station = Station(self.config.stations[0], self.config)

    def meet(self) -> None:
        """Meets it."""
        meet(self.station, self.config, self.line, self.line.clock)


def test_a_lost_reply_is_asked_for_again() -> None:
    """Any lost reply is asked for again, and in the end everything is known."""
    panel = Panel()
    faults = [Fault.LOSE_REPLY, None, Fault.GARBLE_REPLY]
    panel.line.fault = lambda _: faults.pop(0) if faults else None
    panel.meet()
    assert (panel.station.inputs.value, panel.station.outputs.value) == (0, 0)
    assert panel.station.settings == panel.line.modules[1].settings


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (Fault.LOSE_REQUEST, "does not answer modbus-rtu at 9600 baud on /dev/rs485"),
        (Fault.GARBLE_REPLY, "station 1 cannot be understood: "),
        (Fault.REFUSE, "station 1 cannot be understood: refused with code 4"),
    ],
)
def test_three_times_is_enough(fault: Fault, words: str) -> None:
    """After three lost replies the contact fails with the last error."""
    panel = Panel()
    panel.line.fault = lambda _: fault
    with pytest.raises(NotMetError, match=words):
        panel.meet()


def test_another_model_is_not_met() -> None:
    """Another model than expected is an error that names it."""
    panel = Panel()
    panel.line.modules[1] = SimulatedModule(DO100, 1, clock=panel.line.clock)
    with pytest.raises(NotMetError, match="station 1 is configured as DIO100, but it has no inp"):
        panel.meet()


def test_a_port_that_goes_is_its_own_error() -> None:
    """A lost port is raised as PortError, without another try."""
    panel = Panel()
    panel.line.fault = lambda _: Fault.PORT_GONE
    with pytest.raises(PortError):
        panel.meet()
