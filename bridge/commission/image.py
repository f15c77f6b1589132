"""An EEPROM image in a file: Intel HEX or raw binary, by its file name or by `--format`.

Intel HEX also holds the model. A raw file has no place for it.
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
    """The format of an image file."""

    HEX = "hex"
    BINARY = "bin"


@dataclass(frozen=True, slots=True)
class Image:
    """The content of an image file.

    Attributes:
        content: The bytes by address; it may be a part of the EEPROM.
        model: The model that it was read from; None: unknown.
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
    """Return the format that the file name suggests; None: unknown."""
    return _ENDINGS.get(path.suffix.lower())


def image_text(data: bytes, model: ModuleType) -> str:
    """Return a whole EEPROM as Intel HEX, with its model."""
    return format_hex(data, f"EEPROM of a {model.name}")


def write_image(path: Path, image_format: ImageFormat, data: bytes, model: ModuleType) -> None:
    """Write a whole image. If this fails, the file stays as it was.

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
            fresh.unlink()  # it is still there after an interruption


def read_image(path: Path, image_format: ImageFormat, *, partial: bool = False) -> Image:
    """Return the content of a file. `partial`: a raw file may be shorter than the EEPROM.

    Raises:
        BridgeError: It cannot be read, or is not an image of this EEPROM.
    """
    try:
        content = read_file(path, _MOST_BYTES)
    except OSError as error:
        raise BridgeError(f"{path} cannot be read: {error.strerror}") from error
    try:
        if image_format is ImageFormat.HEX:
            # Latin-1 accepts any byte: a character that is no hex digit is then reported with its
            # line.
            return parse_image(content.decode("latin-1"))
        return _raw(content, partial=partial)
    except ValueError as error:
        raise BridgeError(f"{path}: {error}") from error


def parse_image(text: str) -> Image:
    """Return the image in Intel HEX text.

    Raises:
        ValueError: It is not an image of this EEPROM; the message names the wrong line.
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
