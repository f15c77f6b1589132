"""A broker that delivers what it stored as if it were new: without the retain flag."""

import threading
from collections.abc import Sequence
from types import TracebackType
from typing import Self

from support.scripted_broker import (
    CONNACK_5,
    CONNACK_311,
    CONNECT,
    PINGREQ,
    PUBLISH,
    SUBSCRIBE,
    ScriptedBroker,
    suback,
    version_of,
)

_PINGRESP = bytes.fromhex("d0 00")
_UNSUBSCRIBE = 0xA0


class ForgetfulBroker:
    """Stores commands, and tells them behind each SUBACK and behind the first ping.

    Attributes:
        refusals: Verdicts that refused one of them as `stale_link`.
    """

    def __init__(self, ping_topic: str, stored: Sequence[tuple[str, bytes]]) -> None:
        self.refusals = 0
        self._ping_topic = ping_topic.encode()
        self._stored = stored
        self._version = 5
        self._has_pinged = False
        self._online = 0
        self._changed = threading.Condition()
        self._broker = ScriptedBroker(self._answer)

    def __enter__(self) -> Self:
        self._broker.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._broker.__exit__(kind, error, trace)

    @property
    def port(self) -> int:
        """Return the port on which it listens."""
        return self._broker.port

    def wait_for_online(self, times: int) -> None:
        """Wait until the bridge said so often that it is online."""
        with self._changed:
            assert self._changed.wait_for(lambda: self._online >= times, 30)

    def _answer(self, kind: int, body: bytes) -> bytes | None:
        if kind == CONNECT:
            self._version, self._has_pinged = version_of(body), False
            return CONNACK_5 if self._version == 5 else CONNACK_311
        if kind == SUBSCRIBE:
            filters = _filters(body, self._version)
            answer = suback(body, self._version, *[1] * len(filters))
            return answer + (self._all() if any(b"/set" in one for one in filters) else b"")
        if kind == PUBLISH:
            return self._published(body)
        if kind == _UNSUBSCRIBE:
            return (
                bytes([0xB0, 4, *body[:2], 0, 0]) if self._version == 5 else b"\xb0\x02" + body[:2]
            )
        return _PINGRESP if kind == PINGREQ else b""

    def _published(self, body: bytes) -> bytes:
        length = int.from_bytes(body[:2])
        topic, rest = body[2 : 2 + length], body[2 + length :]
        if topic == self._ping_topic:
            first, self._has_pinged = not self._has_pinged, True
            echo = self._message(topic, rest[1:] if self._version == 5 else rest)
            return echo + (self._all() if first else b"")
        if topic.endswith(b"/result"):
            self.refusals += b'"stale_link"' in rest
        if topic.endswith(b"bridge/state") and rest.endswith(b"online"):
            with self._changed:
                self._online += 1
                self._changed.notify_all()
        if topic.endswith((b"/ping", b"/set")):
            return b""
        return b"\x40\x02" + rest[:2]  # PUBACK: what is left is of QoS 1

    def _all(self) -> bytes:
        return b"".join(self._message(topic.encode(), text) for topic, text in self._stored)

    def _message(self, topic: bytes, payload: bytes) -> bytes:
        properties = b"\0" if self._version == 5 else b""
        body = len(topic).to_bytes(2) + topic + properties + payload
        assert len(body) < 128 * 128
        return bytes([PUBLISH, *_length(len(body))]) + body


def _length(count: int) -> bytes:
    return bytes([count]) if count < 128 else bytes([count % 128 | 128, count // 128])


def _filters(subscribe: bytes, version: int) -> list[bytes]:
    at, found = 3 if version == 5 else 2, []
    while at < len(subscribe):
        length = int.from_bytes(subscribe[at : at + 2])
        found.append(subscribe[at + 2 : at + 2 + length])
        at += 3 + length
    return found
