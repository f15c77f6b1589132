import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.mqtt.incoming import KEPT_BYTES, MOST_PACKET_BYTES, IncomingGuard, as_number

TOO_MANY = MOST_PACKET_BYTES + 1


def publish(payload: bytes, qos: int = 0, properties: bytes | None = None) -> bytes:
    """A PUBLISH to `t` with message id 7; `properties`: MQTT 5."""
    body = b"\x00\x01t" + (b"\x00\x07" if qos else b"")
    if properties is not None:
        body += as_number(len(properties)) + properties
    body += payload
    return bytes([0x30 | qos << 1]) + as_number(len(body)) + body


class Reader:
    """Reads through a guard as paho does, from a stream that stalls where chunks end."""

    def __init__(self, stream: bytes, chunk: int, *, has_properties: bool = False) -> None:
        self.rest = stream
        self._chunk = chunk
        self._left = chunk
        self.guard = IncomingGuard(self._receive, has_properties=has_properties)

    def packets(self) -> list[tuple[bytes, int]]:
        """All packets that come out, and how long those were that were cut."""
        packets = []
        while (first := self._exactly(1)) != b"":
            header = first
            while len(header) == 1 or header[-1] & 0x80:
                header += self._exactly(1)
            length = sum((b & 0x7F) << 7 * n for n, b in enumerate(header[1:]))
            packets.append((header + self._exactly(length), self.guard.cut_bytes))
        return packets

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            try:
                more = self.guard.read(count - len(data))
            except BlockingIOError:
                self._left = self._chunk
                continue
            if not more:
                return data
            data += more
        return data

    def _receive(self, count: int) -> bytes:
        if self.rest and not self._left:
            raise BlockingIOError
        data, self.rest = self._take(min(count, self._left or 1))
        self._left -= len(data)
        return data

    def _take(self, count: int) -> tuple[bytes, bytes]:
        return self.rest[:count], self.rest[count:]


@settings(max_examples=50)
@given(
    sizes=st.lists(st.sampled_from([0, 1, 100, 200, 20_000, TOO_MANY, TOO_MANY + 5]), max_size=5),
    qos=st.integers(0, 1),
    chunk=st.sampled_from([40_000, 65_537, 1 << 30]),
)
def test_packets_come_out_whole_and_long_ones_cut(sizes: list[int], qos: int, chunk: int) -> None:
    """However the bytes arrive, short packets pass unchanged and long ones are shortened."""
    packets = [publish(b"x" * size, qos) for size in sizes]
    cut = publish(b"x" * KEPT_BYTES, qos)
    expected = [
        (cut, len(packet)) if len(packet) > MOST_PACKET_BYTES else (packet, 0) for packet in packets
    ]
    assert Reader(b"".join(packets), chunk).packets() == expected


def test_the_properties_of_a_long_message_stay() -> None:
    """MQTT 5: who sent it gets its answer where it asked for it."""
    long = publish(b"x" * TOO_MANY, 1, b"\x08\x00\x01r")
    reader = Reader(long, 1 << 30, has_properties=True)
    assert reader.packets() == [(publish(b"x" * KEPT_BYTES, 1, b"\x08\x00\x01r"), len(long))]


def test_long_properties_are_left_out() -> None:
    """A broker that passes on megabytes of them is not helped with our memory."""
    long = publish(b"x", 1, b"\x08" * TOO_MANY)
    [(packet, size)] = Reader(long, 1 << 30, has_properties=True).packets()
    assert size == len(long)
    assert packet[:3] == publish(b"\0" * KEPT_BYTES, 1, b"")[:3]
    assert packet[3:9] == b"\x00\x01t\x00\x07\x00"


def test_a_long_packet_that_is_no_message_ends_the_connection() -> None:
    """No answer of a broker is so long."""
    guard = Reader(b"\x90" + as_number(TOO_MANY), 1 << 30).guard
    with pytest.raises(ConnectionError, match="is no message"):
        guard.read(1)


def test_a_length_without_end_ends_the_connection() -> None:
    """A length has four bytes at most."""
    guard = Reader(b"\x30\xff\xff\xff\xff\xff", 1 << 30).guard
    with pytest.raises(ConnectionError, match="no MQTT"):
        guard.read(1)


@pytest.mark.parametrize("cut_at", [1, 3, 100, 200_000])
def test_a_close_within_a_packet_is_a_close(cut_at: int) -> None:
    """Wherever it comes, the reader hears the end."""
    reader = Reader(publish(b"x" * TOO_MANY)[:cut_at], 1 << 30)
    while reader.rest:
        reader.guard.read(1)
    assert reader.guard.read(1) == b""
