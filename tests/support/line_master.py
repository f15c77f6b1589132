"""A master on a simulated line that knows no protocol: bytes out, bytes in."""

import os
import select
import socket
import time
from typing import Self
from urllib.parse import urlsplit

PATIENCE_S = 10.0  # generous: the machine may be busy


class LineMaster:
    """Opens a port as `SimulatedLine.port` names it. Reads end at a deadline with what came."""

    def __init__(self, port: str) -> None:
        self._socket: socket.socket | None = None
        if port.startswith("tcp://"):
            address = urlsplit(port)
            self._socket = socket.create_connection((address.hostname, address.port))
            self._socket.setblocking(False)
            self.fileno = self._socket.fileno()
        else:
            self.fileno = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._socket:
            self._socket.close()
        else:
            os.close(self.fileno)

    def send(self, data: bytes) -> None:
        """Sends all of it."""
        assert os.write(self.fileno, data) == len(data)

    def receive(self, count: int, patience_s: float = PATIENCE_S) -> bytes:
        """Returns `count` bytes; fewer when they do not come or the line hangs up."""
        received = b""
        deadline = time.monotonic() + patience_s
        while len(received) < count and (left := deadline - time.monotonic()) > 0:
            ready, _, _ = select.select([self.fileno], [], [], left)
            data = os.read(self.fileno, count - len(received)) if ready else b""
            if ready and not data:
                break
            received += data
        return received

    def ask(self, request: bytes, count: int, patience_s: float = PATIENCE_S) -> bytes:
        """Sends a request and returns the `count` bytes that come back."""
        self.send(request)
        return self.receive(count, patience_s)

    def hung_up(self) -> bool:
        """Waits for the far side to go away."""
        poll = select.poll()
        poll.register(self.fileno, select.POLLIN)
        if not poll.poll(PATIENCE_S * 1000):
            return False
        try:
            return os.read(self.fileno, 1) == b""
        except OSError:
            return True
