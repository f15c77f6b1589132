"""Waits for a server that tells nobody when it listens."""

import socket
import time

_AGAIN_S = 0.05


def wait_until_it_listens(port: int, patience_s: float) -> None:
    """Returns when a loopback port takes connections: it is tried again and again."""
    deadline = time.monotonic() + patience_s
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), 1).close()
        except OSError:
            assert time.monotonic() < deadline, f"nothing listens on {port}"
            time.sleep(_AGAIN_S)
        else:
            return
