"""An EEPROM image in a file: Intel HEX or raw binary, by its ending or by `--format`."""

import os
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path

from bridge.commission.intel_hex import format_hex, parse_hex
from bridge.errors import BridgeError
from bridge.protocol.wisco_eeprom import EEPROM_BYTES


class ImageFormat(StrEnum):
    """How an image stands in a file."""

    HEX = "hex"
    BINARY = "bin"


_ENDINGS = {
    ".hex": ImageFormat.HEX,
    ".ihex": ImageFormat.HEX,
    ".ihx": ImageFormat.HEX,
    ".bin": ImageFormat.BINARY,
    ".raw": ImageFormat.BINARY,
}


def format_of(path: Path) -> ImageFormat | None:
    """Tells the format by the name's ending; None: it says nothing."""
    return _ENDINGS.get(path.suffix.lower())


def write_image(path: Path, image_format: ImageFormat, data: bytes) -> None:
    """Writes a whole image: all of it, or the file stays what it was.

    Raises:
        BridgeError: It cannot be written there.
    """
    content = format_hex(data).encode("ascii") if image_format is ImageFormat.HEX else data
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        fresh.write_bytes(content)
        fresh.replace(path)
    except OSError as error:
        fresh.unlink(missing_ok=True)
        raise BridgeError(f"{path} cannot be written: {error.strerror}") from error


def read_image(path: Path, image_format: ImageFormat) -> Mapping[int, int]:
    """Reads which byte is to stand at which address; a part of the EEPROM will do.

    Raises:
        BridgeError: It cannot be read, or is no image of this EEPROM.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise BridgeError(f"{path} cannot be read: {error.strerror}") from error
    try:
        return _checked(_parsed(content, image_format))
    except ValueError as error:
        raise BridgeError(f"{path}: {error}") from error


def _parsed(content: bytes, image_format: ImageFormat) -> Mapping[int, int]:
    if image_format is ImageFormat.BINARY:
        return dict(enumerate(content))
    # Latin-1 takes any byte: what is no hex digit is complained of with its line.
    return parse_hex(content.decode("latin-1"))


def _checked(image: Mapping[int, int]) -> Mapping[int, int]:
    if not image:
        raise ValueError("there is not a single byte in it")
    if max(image) >= EEPROM_BYTES:
        raise ValueError(
            f"it goes up to {max(image):04X}h, and the EEPROM ends at {EEPROM_BYTES - 1:04X}h"
        )
    return image
