"""Contacts one station on an open port, as the bridge does, for a command that asks once."""

from collections.abc import Callable

from bridge.commission.asker import Asker
from bridge.commission.examine import Examination
from bridge.commission.findings import Clash, Found
from bridge.config.schema import InputConfig, LineConfig, OutputConfig, StationConfig
from bridge.errors import BridgeError, ExchangeError, NoReplyError
from bridge.line.actions.contact import make_contact
from bridge.line.exchanger import Exchanger
from bridge.line.station import Station
from bridge.model import ModuleType
from bridge.transport.port import Port
from bridge.transport.timing import LineTiming

_TRIES = 3


class NotMetError(BridgeError):
    """There is no answer, or another module answers."""


def plain_station(address: int, model: ModuleType) -> StationConfig:
    """Return a station of which only address and model are known."""
    return StationConfig(
        address=address,
        model=model,
        id=f"station-{address}",
        name=f"station {address}",
        inputs=tuple(InputConfig(channel) for channel in range(1, model.inputs + 1)),
        outputs=tuple(OutputConfig(channel) for channel in range(1, model.outputs + 1)),
    )


def find_model(port: Port, line: LineConfig, address: int) -> ModuleType:
    """Return the model of a station, found by reads that one of the models refuses.

    Raises:
        NotMetError: No answer, or none that makes sense.
        PortError: The port is gone.
    """
    asker = Asker(port, LineTiming.from_config(line))
    for _ in range(_TRIES):
        examination = Examination(asker, line.baud, line.protocol, address)
        if not examination.probe():
            continue
        match examination.run():
            case Found(model=model):
                return model
            case Clash() as clash:
                raise NotMetError(garbled(clash))
    raise NotMetError(silent(line, address))


def meet(station: Station, line: LineConfig, bus: Exchanger, clock: Callable[[], float]) -> None:
    """Read everything about a station; repeat reads whose reply is lost.

    Raises:
        NotMetError: There is no answer, or another module answers.
        PortError: The port is gone.
    """
    trouble = ""
    for _ in range(_TRIES):
        try:
            complaint = make_contact(station, bus, clock)
        except NoReplyError:
            trouble = silent(line, station.config.address)
        except ExchangeError as error:
            trouble = f"station {station.config.address} cannot be understood: {error}"
        else:
            if complaint is None:
                return
            raise NotMetError(f"station {station.config.address} is {complaint}")
        station.forget()
    raise NotMetError(trouble)


def silent(line: LineConfig, address: int) -> str:
    """Return the message for a module that does not answer."""
    return (
        f"station {address} does not answer {line.protocol} at {line.baud} baud on {line.port}: "
        f"`wisco2mqtt scan {line.port}` finds out who does"
    )


def garbled(clash: Clash) -> str:
    """Return the message for an address whose answers make no sense."""
    return (
        f"station {clash.address}: {clash.damaged} of {clash.asked} answers are garbled, as when "
        f"two modules have one address ({'; '.join(clash.evidence)})"
    )
