"""Reads small regular files that a user named, and writes files as a whole.

Devices, pipes and endless files are refused.
"""

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


def replace_file(path: Path, data: bytes, mode: int | None = None) -> None:
    """Write the whole content or nothing, even if the power fails meanwhile.

    `mode` are the permissions of the new file; None: as the process makes files.

    Raises:
        OSError: It was not written; the old file is unchanged.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f"{path.name}.new")
    with fresh.open("wb") as file:
        if mode is not None:
            os.fchmod(file.fileno(), mode)
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    fresh.replace(path)
    # Only when the folder is on the disk too does a new name in it survive a power cut.
    descriptor = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _check_kind(found: os.stat_result, path: Path) -> None:
    kind = stat.S_IFMT(found.st_mode)
    if kind != stat.S_IFREG:
        what = _KINDS.get(kind, "it is something else")
        raise OSError(errno.EINVAL, f"{what}, not a file", str(path))
