"""EEPROM images in files: by their endings, whole, and within the EEPROM."""

from pathlib import Path

import pytest

from bridge.commission.image import Image, ImageFormat, format_of, read_image, write_image
from bridge.errors import BridgeError
from bridge.model import DIO100, DO100

WHOLE = bytes(range(256)) * 8
ONE = b":0100000001FE\n:00000001FF\n"


@pytest.mark.parametrize("image_format", ImageFormat)
def test_an_image_reads_back(image_format: ImageFormat, tmp_path: Path) -> None:
    """An image of either format reads back: all 2,048 bytes, and in Intel HEX the model."""
    path = tmp_path / "image"
    write_image(path, image_format, WHOLE, DO100)
    model = DO100 if image_format is ImageFormat.HEX else None
    assert read_image(path, image_format) == Image(dict(enumerate(WHOLE)), model)
    assert [each.name for each in tmp_path.iterdir()] == ["image"]


@pytest.mark.parametrize(
    ("name", "image_format"),
    [("a.hex", ImageFormat.HEX), ("a.BIN", ImageFormat.BINARY), ("a.txt", None), ("a", None)],
)
def test_the_ending_tells_the_format(name: str, image_format: ImageFormat | None) -> None:
    """Other endings say nothing."""
    assert format_of(Path(name)) is image_format


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    """An unreadable file, or a missing folder for a new file, is named in the error."""
    with pytest.raises(BridgeError, match=r"gone\.bin cannot be read: No such file"):
        read_image(tmp_path / "gone.bin", ImageFormat.BINARY)
    with pytest.raises(BridgeError, match=r"a\.bin cannot be written: No such file"):
        write_image(tmp_path / "gone" / "a.bin", ImageFormat.BINARY, WHOLE, DIO100)


@pytest.mark.parametrize(
    ("content", "image_format", "complaint"),
    [
        (b"", ImageFormat.BINARY, "not a single byte"),
        (b":00000001FF", ImageFormat.HEX, "not a single byte"),
        (bytes(2049), ImageFormat.BINARY, "goes up to 0800h, and the EEPROM ends at 07FFh"),
        (bytes(2048), ImageFormat.HEX, "line 1: a record is a colon"),
        (bytes(100), ImageFormat.BINARY, "it has 100 bytes, and a whole EEPROM 2048: is it cut"),
        (bytes(2**20 + 1), ImageFormat.BINARY, "it is longer than 1048576 bytes"),
        (ONE + b"; EEPROM of a DI100\n", ImageFormat.HEX, "of a DI100, and there is no such model"),
        (
            ONE + b"; EEPROM of a DIO100\n; EEPROM of a DO100\n",
            ImageFormat.HEX,
            "it says that it is of DIO100 and of DO100: which is it",
        ),
    ],
)
def test_what_is_no_image_is_refused(
    content: bytes, image_format: ImageFormat, complaint: str, tmp_path: Path
) -> None:
    """An empty file, one that is too long, or the other format is refused."""
    path = tmp_path / "image"
    path.write_bytes(content)
    with pytest.raises(BridgeError, match=complaint):
        read_image(path, image_format)


def test_a_part_of_a_raw_image_is_taken_where_it_is_meant(tmp_path: Path) -> None:
    """With `partial` a short raw file is taken as the first bytes of the EEPROM."""
    path = tmp_path / "image"
    path.write_bytes(b"\x07" * 100)
    part = read_image(path, ImageFormat.BINARY, partial=True)
    assert part == Image(dict.fromkeys(range(100), 7))
