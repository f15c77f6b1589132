"""A simulated line behind a TCP port on the loopback, as behind a serial device server."""

import contextlib
import os
import socket

from bridge.simulator.endpoint import READ_AT_MOST, write_patiently

HOST = "127.0.0.1"


class TcpEndpoint:
    """Listens on the loopback for one connection at a time; a new connection replaces the old one.

    Port 0: a free port is chosen at the first opening, and kept over hang-ups.
    """

    def __init__(self, port: int = 0) -> None:
        self._port = port
        self._listener: socket.socket | None = None
        self._peer: socket.socket | None = None

    @property
    def port(self) -> str:
        """Return the address as a configuration writes it."""
        return f"tcp://{HOST}:{self._port}"

    def open(self) -> None:
        """Start to listen."""
        self._listener = socket.create_server((HOST, self._port))
        self._listener.setblocking(False)
        self._port = self._listener.getsockname()[1]

    def filenos(self) -> list[int]:
        """Return the listening socket and the connection."""
        return [each.fileno() for each in (self._listener, self._peer) if each]

    def read(self, fileno: int) -> bytes:
        """Return the bytes that came in; a new connection brings none yet."""
        if self._listener and fileno == self._listener.fileno():
            self._accept(self._listener)
            return b""
        try:
            data = os.read(fileno, READ_AT_MOST)
        except BlockingIOError:
            return b""
        except ConnectionError:
            data = b""
        if not data:
            self._drop_peer()
        return data

    def _accept(self, listener: socket.socket) -> None:
        try:
            peer, _ = listener.accept()
        except (BlockingIOError, ConnectionError):  # the client was gone before it was accepted
            return
        self._drop_peer()
        peer.setblocking(False)
        # Each piece is sent at its own time, as by a device server without packing delay.
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._peer = peer

    def write(self, data: bytes) -> None:
        """Hand bytes to the connection, if there is one."""
        if self._peer:
            with contextlib.suppress(ConnectionError):  # the next read reports it
                write_patiently(self._peer.fileno(), data)

    def baud(self) -> int | None:
        """Return None: over a network the baud rate of the master is not known."""
        return None

    def hang_up(self) -> None:
        """Drop the connection and refuse new ones."""
        self._drop_peer()
        if self._listener:
            self._listener.close()
            self._listener = None

    def close(self) -> None:
        """Close the endpoint for good."""
        self.hang_up()

    def _drop_peer(self) -> None:
        if self._peer:
            self._peer.close()
            self._peer = None
