"""The broker of the demo: it is a library's, and its errors are not the newcomer's."""

import socket

import pytest
from amqtt.broker import Broker

from bridge.cli.demo_broker import DemoBroker, free_port

WAIT_S = 10.0


def test_an_error_in_a_connection_ends_it_and_shows_no_traceback(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The library fails if a client subscribes while another connects; that one tries again."""

    async def fail(*_: object, **__: object) -> None:
        raise RuntimeError("dictionary changed size during iteration")

    monkeypatch.setattr(Broker, "stream_connected", fail)
    broker = DemoBroker(free_port(0))
    broker.start()
    try:
        with socket.create_connection(("127.0.0.1", broker.port), timeout=WAIT_S) as client:
            assert client.recv(1) == b""
    finally:
        broker.stop()
    assert not caplog.records
