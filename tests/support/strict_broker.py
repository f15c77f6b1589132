"""A broker that allows little, and says so or just closes, as in clouds and gateways."""

from dataclasses import dataclass

from support.scripted_broker import CONNECT, PINGREQ, PUBLISH, SUBSCRIBE, ScriptedBroker, version_of

PINGRESP = b"\xd0\x00"
NO_WILDCARDS, TOO_LARGE, NO_RETAIN, NO_QOS = 0xA2, 0x95, 0x9A, 0x9B


@dataclass(frozen=True, slots=True)
class Allows:
    """What the broker allows.

    Attributes:
        filters: How many a SUBSCRIBE may have; with more it closes the connection.
        packet_bytes: The longest packet; at a longer one it closes.
        qos: The highest QoS of a message; at a higher one it closes.
        retain: Messages may be retained; at one it closes.
        wildcards: Filters may have some; one that has is refused.
        says: It tells what it allows in CONNACK (MQTT 5), and why it closes.
    """

    filters: int = 1000
    packet_bytes: int = 1 << 28
    qos: int = 2
    retain: bool = True
    wildcards: bool = True
    says: bool = True

    def properties(self) -> bytes:
        """Return the properties of its CONNACK of MQTT 5."""
        if not self.says:
            return b""
        told = b""
        if self.packet_bytes < 1 << 28:
            told += b"\x27" + self.packet_bytes.to_bytes(4)
        if self.qos < 2:
            told += bytes([0x24, self.qos])
        if not self.retain:
            told += b"\x25\x00"
        return told if self.wildcards else told + b"\x28\x00"


class StrictBroker(ScriptedBroker):
    """Takes messages as `allows` says, and gives pings back.

    Attributes:
        filters: What was subscribed, oldest first.
        messages: The last payload of each topic that was taken.
        connects: How many connections were taken.
    """

    def __init__(self, allows: Allows) -> None:
        super().__init__(self._answer)
        self.filters: list[str] = []
        self.messages: dict[str, bytes] = {}
        self.connects = 0
        self._allows = allows
        self._v5 = True

    def _answer(self, kind: int, body: bytes) -> bytes | None:
        flags = self.flags[-1]
        if len(body) + 1 + _length_bytes(len(body)) > self._allows.packet_bytes:
            return self._closes(TOO_LARGE)
        match kind:
            case _ if kind == CONNECT:
                return self._connack(body)
            case _ if kind == SUBSCRIBE:
                return self._suback(body)
            case _ if kind == PUBLISH:
                return self._puback(body, flags)
            case _ if kind == PINGREQ:
                return PINGRESP
        return b""

    def _connack(self, body: bytes) -> bytes:
        self._v5 = version_of(body) == 5
        if not self._v5:
            self.connects += 1
            return bytes.fromhex("20 02 00 00")
        will_qos, will_retain = body[7] >> 3 & 3, body[7] >> 5 & 1
        reason = NO_QOS if will_qos > self._allows.qos else 0
        reason = NO_RETAIN if will_retain and not self._allows.retain else reason
        self.connects += reason == 0
        properties = self._allows.properties()
        return bytes([0x20, 3 + len(properties), 0, reason, len(properties)]) + properties

    def _suback(self, body: bytes) -> bytes | None:
        filters = _filters(body[3 + body[2] :] if self._v5 else body[2:])
        if len(filters) > self._allows.filters:
            return None
        refuses = [not self._allows.wildcards and "+" in one for one in filters]
        self.filters += [one for one, refused in zip(filters, refuses, strict=True) if not refused]
        reasons = bytes(NO_WILDCARDS if refused else 1 for refused in refuses)
        answer = body[:2] + (b"\0" if self._v5 else b"") + reasons
        return b"\x90" + bytes([len(answer)]) + answer

    def _puback(self, body: bytes, flags: int) -> bytes | None:
        qos = flags >> 1 & 3
        if qos > self._allows.qos:
            return self._closes(NO_QOS)
        if flags & 1 and not self._allows.retain:
            return self._closes(NO_RETAIN)
        end = 2 + int.from_bytes(body[:2])
        topic = body[2:end].decode()
        payload = body[end + (2 if qos else 0) :]
        if self._v5:
            payload = payload[1 + payload[0] :]
        self.messages[topic] = payload
        answer = b"\x40\x02" + body[end : end + 2] if qos else b""
        if topic.endswith("/ping"):
            echo = body[:end] + (b"\0" if self._v5 else b"") + payload
            answer += bytes([0x30, len(echo)]) + echo
        return answer

    def _closes(self, reason: int) -> bytes | None:
        if self._v5 and self._allows.says:
            self.send(bytes([0xE0, 2, reason, 0]))
        return None


def _length_bytes(length: int) -> int:
    return 1 + (length > 127) + (length > 16_383) + (length > 2_097_151)


def _filters(data: bytes) -> list[str]:
    filters = []
    while data:
        end = 2 + int.from_bytes(data[:2])
        filters.append(data[2:end].decode())
        data = data[end + 1 :]
    return filters
