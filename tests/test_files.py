"""Files that a person names: only what is a file, and has an end, is read."""

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.files import read_file


def _pipe(path: Path) -> Path:
    os.mkfifo(path)
    return path


def _socket(path: Path) -> Path:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))
    return path


def _folder(path: Path) -> Path:
    path.mkdir()
    return path


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (_pipe, "it is a pipe, not a file"),
        (_socket, "it is a socket, not a file"),
        (_folder, "it is a directory, not a file"),
        (lambda _: Path("/dev/zero"), "it is a device, not a file"),
        (lambda path: path, "No such file or directory"),
    ],
)
def test_what_is_no_file_is_refused_at_once(
    make: Callable[[Path], Path], told: str, tmp_path: Path
) -> None:
    """A pipe without a writer and an endless device are refused at once."""
    with pytest.raises(OSError, match=told):
        read_file(make(tmp_path / "named"))


def test_a_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    """One byte more, and it is refused; a link to a file is as good as the file."""
    path, link = tmp_path / "file", tmp_path / "link"
    path.write_bytes(b"12345")
    link.symlink_to(path)
    assert read_file(link, 5) == b"12345"
    with pytest.raises(OSError, match="it is longer than 4 bytes"):
        read_file(path, 4)
