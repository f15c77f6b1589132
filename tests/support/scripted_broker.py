"""A broker that says what a script tells it to: what old, broken or strict brokers would."""

import socket
import threading
from collections.abc import Callable, Iterator
from typing import Self

CONNECT, PUBLISH, SUBSCRIBE, PINGREQ = 0x10, 0x30, 0x80, 0xC0
CONNACK_5 = bytes.fromhex("20 03 00 00 00")
CONNACK_311 = bytes.fromhex("20 02 00 00")

Script = Callable[[int, bytes], bytes | None]


def version_of(connect: bytes) -> int:
    """The protocol level of a CONNECT's body: 5, or 4 for MQTT 3.1.1."""
    return connect[6]


def suback(subscribe: bytes, version: int, *reasons: int) -> bytes:
    """Answers a SUBSCRIBE's body with one reason code for each filter."""
    body = subscribe[:2] + (b"\x00" if version == 5 else b"") + bytes(reasons)
    return bytes([0x90, len(body)]) + body


class ScriptedBroker:
    """Answers every packet with what `script(kind, body)` returns; None: closes.

    Attributes:
        packets: The kind and body of every packet that arrived, over all connections.
        flags: The flags of each of these packets.
    """

    def __init__(self, script: Script) -> None:
        self.packets: list[tuple[int, bytes]] = []
        self.flags: list[int] = []
        self.port = 0
        self._script = script
        self._listener = socket.socket()
        self._open: list[socket.socket] = []
        self._arrived = threading.Condition()
        self._threads = [threading.Thread(target=self._accept, name="scripted broker")]

    def __enter__(self) -> Self:
        self._listener.bind(("127.0.0.1", 0))
        self._listener.listen()
        self.port = self._listener.getsockname()[1]
        self._threads[0].start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._threads[0].join()
        self._listener.close()
        for connection in self._open:
            _shut(connection)
        for thread in self._threads:
            thread.join()

    def bodies(self, kind: int) -> list[bytes]:
        """The bodies of all packets of one kind."""
        return [body for each, body in list(self.packets) if each == kind]

    def wait(self, kind: int, count: int = 1) -> None:
        """Waits until `count` packets of this kind arrived."""
        with self._arrived:
            held = self._arrived.wait_for(lambda: len(self.bodies(kind)) >= count, 20)
            assert held, f"no {count} packets {kind:#x}: {self.packets}"

    def wait_until(self, condition: Callable[[], bool]) -> None:
        """Waits until `condition` holds; it is asked after each packet."""
        with self._arrived:
            assert self._arrived.wait_for(condition, 20), "the condition does not hold after 20 s"

    def send(self, data: bytes) -> None:
        """Says something unasked on the newest connection."""
        self._open[-1].sendall(data)

    def cut(self) -> None:
        """Closes the newest connection."""
        _shut(self._open[-1])

    def _accept(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:  # shut down: the test is over
                return
            self._open.append(connection)
            thread = threading.Thread(target=self._serve, args=[connection], name="scripted")
            self._threads.append(thread)
            thread.start()

    def _serve(self, connection: socket.socket) -> None:
        with connection:
            for first, body in _packets(connection):
                kind = first & 0xF0
                with self._arrived:
                    self.flags.append(first & 0x0F)
                    self.packets.append((kind, body))
                    self._arrived.notify_all()
                answer = self._script(kind, body)
                if answer is None:
                    return
                try:
                    connection.sendall(answer)
                except OSError:  # the client did not wait for it
                    return


def _shut(connection: socket.socket) -> None:
    try:
        connection.shutdown(socket.SHUT_RDWR)
    except OSError:
        return  # closed already


def _packets(connection: socket.socket) -> Iterator[tuple[int, bytes]]:
    """Yields the first byte and the body of each packet."""
    try:
        with connection.makefile("rb") as stream:
            while first := stream.read(1):
                length, shift = 0, 0
                while True:
                    byte = stream.read(1)[0]
                    length |= (byte & 0x7F) << shift
                    shift += 7
                    if not byte & 0x80:
                        break
                yield first[0], stream.read(length)
    except (OSError, IndexError):
        return  # the client went away in the middle of a packet
