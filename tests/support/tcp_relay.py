"""A relay between a client and a loopback port whose links can be cut as a router would."""

import select
import socket
import threading
from enum import Enum
from typing import Self


class Way(Enum):
    """Which way bytes go."""

    IN = "client to broker"
    OUT = "broker to client"


class TcpRelay:
    """Listens on `port` and passes all bytes on. One thread; the tests' thread only asks."""

    def __init__(self, target: int) -> None:
        self.port = 0
        self._target = target
        self._listener = socket.socket()
        self._peers: dict[socket.socket, socket.socket] = {}
        self._cut = threading.Event()
        self._stalled: frozenset[Way] = frozenset()
        self._clients: set[socket.socket] = set()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="relay")

    def __enter__(self) -> Self:
        self._listener.bind(("127.0.0.1", 0))
        self._listener.listen()
        self.port = self._listener.getsockname()[1]
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._close_all()
        self._listener.close()

    def cut(self) -> None:
        """Resets every connection without a word of MQTT."""
        self._cut.set()

    def stall(self, *ways: Way) -> None:
        """Passes nothing on from now on, and closes nothing: a black hole, or half of one."""
        self._stalled = frozenset(ways or Way)

    def resume(self) -> None:
        """Passes everything on again."""
        self._stalled = frozenset()

    def _run(self) -> None:
        while not self._over.is_set():
            if self._cut.is_set():
                self._cut.clear()
                self._close_all()
            watched = [sock for sock in (self._listener, *self._peers) if self._passes(sock)]
            for sock in select.select(watched, [], [], 0.02)[0]:
                if not self._passes(sock):
                    continue  # since the select: what came after `stall` is not passed on
                if sock is self._listener:
                    self._accept()
                elif sock in self._peers:
                    self._pass_on(sock)

    def _passes(self, sock: socket.socket) -> bool:
        if sock is self._listener:
            return not self._stalled
        return (Way.IN if sock in self._clients else Way.OUT) not in self._stalled

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        try:
            server = socket.create_connection(("127.0.0.1", self._target))
        except OSError:
            client.close()
            return
        for end in (client, server):  # a relay holds nothing back, as a router does not
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._clients.add(client)
        self._peers[client] = server
        self._peers[server] = client

    def _pass_on(self, sock: socket.socket) -> None:
        peer = self._peers[sock]
        try:
            data = sock.recv(65536)
            peer.sendall(data)
        except OSError:
            data = b""
        if not data:
            for end in (sock, peer):
                self._clients.discard(end)
                self._peers.pop(end).close()

    def _close_all(self) -> None:
        for sock in self._peers:
            # Linger 0: the other side gets a reset, not an orderly end.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
            sock.close()
        self._peers.clear()
        self._clients.clear()
