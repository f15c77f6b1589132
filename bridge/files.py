"""Reads small regular files that a user named, and writes our own, whole or not at all."""

import errno
import os
import stat
from pathlib import Path

# Larger than any configuration or dump, and still read in a moment.
MAX_FILE_BYTES = 8 * 2**20

_KINDS = {
    stat.S_IFDIR: "it is a directory",
    stat.S_IFIFO: "it is a pipe",
    stat.S_IFSOCK: "it is a socket",
    stat.S_IFCHR: "it is a device",
    stat.S_IFBLK: "it is a device",
}


def read_file(path: Path, limit_bytes: int = MAX_FILE_BYTES) -> bytes:
    """Return the content of a regular file.

    Raises:
        OSError: It cannot be read, is not a regular file, or is longer than `limit_bytes`. Its
            `strerror` says which.
    """
    _check_kind(path.stat(), path)  # before it is opened: opening some devices has an effect
    # A pipe that replaces the file in between would block a plain open until it has a writer.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as file:
        _check_kind(os.fstat(descriptor), path)
        data = file.read(limit_bytes + 1)
    if len(data) > limit_bytes:
        raise OSError(errno.EFBIG, f"it is longer than {limit_bytes} bytes", str(path))
    return data


def write_whole(path: Path, data: bytes) -> None:
    """Write all of it or nothing, even if the power fails meanwhile.

    Raises:
        OSError: It was not written; the old file is unchanged.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f"{path.name}.new")
    with fresh.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    fresh.replace(path)
    _keep_name(path.parent)


def _keep_name(folder: Path) -> None:
    """Write the folder to the disk: only then does a new name in it survive a power cut."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _check_kind(found: os.stat_result, path: Path) -> None:
    kind = stat.S_IFMT(found.st_mode)
    if kind != stat.S_IFREG:
        what = _KINDS.get(kind, "it is something else")
        raise OSError(errno.EINVAL, f"{what}, not a file", str(path))
