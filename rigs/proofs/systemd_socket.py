"""Stand in for systemd: the daemon tells it of each reload, and its log only of the first ones."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.daemon import WAIT_S


@contextmanager
def systemd_socket(directory: Path) -> Iterator[socket.socket]:
    """Listen where systemd would."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(directory / "notify"))
        listener.settimeout(WAIT_S)
        yield listener


def wait_ready(systemd: socket.socket) -> None:
    """Wait until the daemon is ready, at first or again."""
    while b"READY=1" not in systemd.recv(4096):
        pass
