"""An EEPROM image in a file: Intel HEX or raw binary, by its ending or by `--format`.

Intel HEX says of which model the EEPROM was. Raw bytes have no place for that.
"""

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from bridge.commission.intel_hex import format_hex, parse_hex
from bridge.errors import BridgeError
from bridge.files import read_file
from bridge.model import MODULE_TYPES, ModuleType
from bridge.protocol.wisco_eeprom import EEPROM_BYTES

# An image with a record for each byte is 28 kB.
_MOST_BYTES = 2**20
_OF_MODEL = re.compile(r"EEPROM of a (\S+)")


class ImageFormat(StrEnum):
    """Describe how an image stands in a file."""

    HEX = "hex"
    BINARY = "bin"


@dataclass(frozen=True, slots=True)
class Image:
    """Describe what is to stand in an EEPROM.

    Attributes:
        content: Which byte at which address; a part of the EEPROM will do.
        model: Whose EEPROM it was; None: nothing says so.
    """

    content: Mapping[int, int]
    model: ModuleType | None = None


_ENDINGS = {
    ".hex": ImageFormat.HEX,
    ".ihex": ImageFormat.HEX,
    ".ihx": ImageFormat.HEX,
    ".bin": ImageFormat.BINARY,
    ".raw": ImageFormat.BINARY,
}


def format_of(path: Path) -> ImageFormat | None:
    """Tell the format by the name's ending; None: it says nothing."""
    return _ENDINGS.get(path.suffix.lower())


def image_text(data: bytes, model: ModuleType) -> str:
    """Return a whole EEPROM as Intel HEX that says whose it was."""
    return format_hex(data, f"EEPROM of a {model.name}")


def write_image(path: Path, image_format: ImageFormat, data: bytes, model: ModuleType) -> None:
    """Write a whole image: all of it, or the file stays what it was.

    Raises:
        BridgeError: It cannot be written there.
    """
    is_hex = image_format is ImageFormat.HEX
    content = image_text(data, model).encode("ascii") if is_hex else data
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        fresh.write_bytes(content)
        fresh.replace(path)
    except OSError as error:
        raise BridgeError(f"{path} cannot be written: {error.strerror}") from error
    finally:
        with suppress(OSError):
            fresh.unlink()  # it is still there where this was interrupted


def read_image(path: Path, image_format: ImageFormat, *, partial: bool = False) -> Image:
    """Return what a file wants of an EEPROM. `partial`: raw bytes may be fewer than it has.

    Raises:
        BridgeError: It cannot be read, or is no image of this EEPROM.
    """
    try:
        content = read_file(path, _MOST_BYTES)
    except OSError as error:
        raise BridgeError(f"{path} cannot be read: {error.strerror}") from error
    try:
        if image_format is ImageFormat.HEX:
            # Latin-1 takes any byte: what is no hex digit is complained of with its line.
            return parse_image(content.decode("latin-1"))
        return _raw(content, partial=partial)
    except ValueError as error:
        raise BridgeError(f"{path}: {error}") from error


def parse_image(text: str) -> Image:
    """Return what Intel HEX text wants of an EEPROM.

    Raises:
        ValueError: It is no image of this EEPROM; with the line, where one is wrong.
    """
    parsed = parse_hex(text)
    return Image(_checked(parsed.content), _model_in(parsed.remarks))


def _model_in(remarks: tuple[str, ...]) -> ModuleType | None:
    names = {found[1] for remark in remarks if (found := _OF_MODEL.fullmatch(remark))}
    if len(names) > 1:
        raise ValueError(f"it says that it is of {' and of '.join(sorted(names))}: which is it?")
    for name in names:
        if name not in MODULE_TYPES:
            raise ValueError(f"it is the EEPROM of a {name}, and there is no such model here")
    return MODULE_TYPES[names.pop()] if names else None


def _raw(content: bytes, *, partial: bool) -> Image:
    image = Image(_checked(dict(enumerate(content))))
    if len(content) < EEPROM_BYTES and not partial:
        raise ValueError(
            f"it has {len(content)} bytes, and a whole EEPROM {EEPROM_BYTES}: is it cut off? "
            "--force takes them as its first bytes"
        )
    return image


def _checked(content: Mapping[int, int]) -> Mapping[int, int]:
    if not content:
        raise ValueError("there is not a single byte in it")
    if max(content) >= EEPROM_BYTES:
        raise ValueError(
            f"it goes up to {max(content):04X}h, and the EEPROM ends at {EEPROM_BYTES - 1:04X}h"
        )
    return content
