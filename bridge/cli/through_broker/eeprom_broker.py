"""`eeprom --broker`: lets the running bridge read an EEPROM between its polls."""

import os
from collections.abc import Mapping
from typing import Any

from bridge.cli.frame.terminal import progress
from bridge.cli.frame.usage import UsageError
from bridge.cli.on_port.one_station import Subject
from bridge.cli.through_broker.ask_bridge import asked
from bridge.commission.image import parse_image
from bridge.config.load import load_config
from bridge.errors import BridgeError
from bridge.line.errand import SHARE
from bridge.model import ModuleType
from bridge.protocol.wisco_eeprom import EEPROM_BYTES

_CHARS_A_BYTE = 3  # two digits, and the share of the frames
_BITS_A_CHAR = 10


def read_through_broker(place: Subject) -> tuple[bytes, ModuleType]:
    """Return the EEPROM and the configured model, which the bridge has checked.

    Raises:
        UsageError: The module is not named by a configuration.
        BridgeError: There is no broker or no bridge, or the bridge refuses.
    """
    if place.config is None or place.station_config is None:
        raise UsageError("--broker goes with a station of the configuration, not with --port")
    config = load_config(place.config, os.environ)
    total_s = EEPROM_BYTES * _CHARS_A_BYTE * _BITS_A_CHAR / place.line.baud / SHARE
    document: Mapping[str, Any] = {}
    with (
        asked(config.mqtt, "eeprom", {"station": place.name}) as answers,
        progress(total_s) as tell,
    ):
        for document in answers:
            done = document.get("progress")
            if isinstance(done, int | float):
                tell((1 - done) * total_s, f"{done:.0%} of {EEPROM_BYTES} bytes read")
    return _image(document), place.station_config.model


def _image(document: Mapping[str, Any]) -> bytes:
    try:
        image = parse_image(str(document.get("image"))).content
    except ValueError as error:
        raise BridgeError(f"the bridge answered what cannot be read: {error}") from error
    if set(image) != set(range(EEPROM_BYTES)):
        raise BridgeError(f"the bridge answered {len(image)} of {EEPROM_BYTES} bytes")
    return bytes(image[address] for address in range(EEPROM_BYTES))
