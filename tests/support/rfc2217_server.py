"""An RFC 2217 server of pyserial's making, whose serial port returns what it is sent."""

import socket
import threading
from typing import Any

import serial
from serial.rfc2217 import PortManager


class Rfc2217Server:
    """Serves one client after the other until closed."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._client: socket.socket | None = None
        self._lock = threading.Lock()
        self.device = serial.serial_for_url("loop://", timeout=0)
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    @property
    def url(self) -> str:
        """Return the URL for a client."""
        return f"rfc2217://127.0.0.1:{self._listener.getsockname()[1]}"

    def write(self, data: bytes) -> None:
        """Sends to the client; PortManager calls it for its own needs."""
        if self._client is not None:
            with self._lock:
                self._client.sendall(data)

    def hang_up(self) -> None:
        """Closes the connection under the client."""
        if self._client is not None:
            self._client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Ends the server."""
        self._listener.shutdown(socket.SHUT_RDWR)
        self.hang_up_quietly()
        self._thread.join(10)
        self._listener.close()
        self.device.close()

    def hang_up_quietly(self) -> None:
        """Closes the connection, if there is one still."""
        try:
            self.hang_up()
        except OSError:
            return

    def _serve(self) -> None:
        while True:
            try:
                self._client, _ = self._listener.accept()
            except OSError:
                return
            with self._client:
                try:
                    self._converse(self._client)
                except OSError:
                    continue

    def _converse(self, client: socket.socket) -> None:
        us: Any = self  # the stubs ask for a whole Serial where `write` is enough
        port: Any = self.device
        manager = PortManager(port, us)
        while data := client.recv(1024):
            self.device.write(b"".join(manager.filter(data)))
            self.write(b"".join(manager.escape(self.device.read(self.device.in_waiting))))
