"""What errands do on their line: a scan, the dump of an EEPROM, a verification."""

from collections.abc import Mapping
from typing import Any

from bridge.commission.eeprom import Eeprom
from bridge.commission.image import image_text
from bridge.commission.line_scan import LineScan
from bridge.commission.survey import STATIONS, parse_stations
from bridge.commission.verify.verification import SAMPLES, Verification, modules_of
from bridge.config.schema import LineConfig, StationConfig
from bridge.drivers import driver_for
from bridge.errors import BridgeError
from bridge.line.actions.contact import wrong_model
from bridge.line.errand import SharedLine, Tell
from bridge.mqtt.strict_json import bad

# A block keeps the line from polls and commands for its whole time: 0.2 s at 4800 baud.
_BLOCK_BYTES = 32
_SAMPLES = range(20, 10_001)


def scan_of(line: LineConfig, stations: object, *, thorough: bool) -> LineScan:
    """Return the scan of a request.

    Args:
        line: The line.
        stations: Such as "1-8,12"; None: all of them.
        thorough: Whether every station is asked several times.

    Raises:
        CommandError: There is no such scan.
    """
    scan = LineScan(line, _stations_of(stations), thorough=thorough)
    if not scan.addresses:
        raise bad("there is nothing to ask: in Modbus, 0 is no station but all of them")
    return scan


def verification_of(line: LineConfig, stations: object, samples: object) -> Verification:
    """Return the verification that a request asks for: it reads alone.

    Args:
        line: The line.
        stations: Such as "1-8,12"; None: all that are configured.
        samples: How often each is asked; None: as often as usual.

    Raises:
        CommandError: There is no such verification.
    """
    count = SAMPLES if samples is None else samples
    if isinstance(count, bool) or not isinstance(count, int) or count not in _SAMPLES:
        raise bad(f"samples is a number from {_SAMPLES[0]} to {_SAMPLES[-1]}")
    modules = modules_of(line, _stations_of(stations))
    if not modules:
        raise bad(f"line {line.id} has none of these stations")
    return Verification(line, modules, count)


def dump(
    line: LineConfig, config: StationConfig, shared: SharedLine, tell: Tell
) -> Mapping[str, Any]:
    """Return the EEPROM of a station as Intel HEX; report the progress.

    Raises:
        BridgeError: It is another model, or cannot be read.
    """
    told = {"station": config.id}
    tell({**told, "progress": 0.0})
    reader = driver_for(line.protocol, config.address, config.model)
    if complaint := wrong_model(config.model, reader, shared):
        raise BridgeError(f"{config.id} is {complaint}")
    eeprom = Eeprom(shared, config.address, _BLOCK_BYTES)
    data = eeprom.read(lambda done, of: tell({**told, "progress": round(done / of, 3)}))
    return {**told, "progress": 1.0, "image": image_text(data, config.model)}


def _stations_of(stations: object) -> tuple[int, ...]:
    if stations is None:
        return tuple(STATIONS)
    if not isinstance(stations, str):
        raise bad('stations is a text, such as "1-8,12"')
    try:
        return parse_stations(stations)
    except ValueError as error:
        raise bad(str(error)) from None
