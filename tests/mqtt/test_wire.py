import logging
import select
import socket

from bridge.bounded_log import BoundedLog
from bridge.config.schema import MqttConfig
from bridge.mqtt.broker_limits import BrokerLimits
from bridge.mqtt.events import OutMessage, Received
from bridge.mqtt.refusals import Answer
from bridge.mqtt.wire import Wire


class Deaf:
    """Takes what the connection tells, and does nothing."""

    def connected(self, answer: Answer, limits: BrokerLimits) -> None:
        """The broker answered CONNECT."""

    def subscribed(self, message_id: int, answers: object) -> None:
        """Return the answer to SUBSCRIBE."""

    def published(self, message_id: int, answer: Answer) -> None:
        """A message is written, or answered."""

    def arrived(self, message: Received | None, cut_bytes: int) -> None:
        """A message came in."""

    def closed(self, answer: Answer, error: str | None, *, by_broker: bool) -> None:
        """The connection ended."""


def wire_to(port: int, *, v5: bool) -> Wire:
    """A connection to a loopback broker, which is not open yet."""
    config = MqttConfig("127.0.0.1", port, "b", "bridge-under-test", "5" if v5 else "3.1.1")
    log = BoundedLog(logging.getLogger(__name__), lambda: 0.0)
    return Wire(config, v5=v5, will=None, timeout_s=1.0, told=Deaf(), log=log)


def test_a_message_on_a_connection_that_is_gone_is_not_written_and_does_no_harm() -> None:
    """Several go out in one step, and the first of them may find the connection broken."""
    for v5 in (True, False):
        wire = wire_to(1, v5=v5)
        for qos in (0, 1):
            _, written = wire.publish(OutMessage("b/bridge/ping", b"x", qos, retain=False))
            assert not written


def test_what_is_read_is_acknowledged_at_once() -> None:
    """A broker that waits for the kernel's acknowledgement sends its next message 40 ms sooner."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        wire = wire_to(server.getsockname()[1], v5=False)
        wire.open()
        broker, _ = server.accept()
        with broker:
            for packet in (b"\x20\x02\x00\x00", b"\xd0\x00"):  # CONNACK, PINGRESP
                wire.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 0)
                broker.sendall(packet)
                select.select([wire.socket], [], [], 5.0)
                wire.read()
                assert wire.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK) == 1
        wire.socket.close()
