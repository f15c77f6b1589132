"""`run` takes base topic and ports before it contacts anything."""

import socket
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import pytest
from support.virtual_worker import make_line

from bridge.cli.frame.locks import SCOPE_VARIABLE, BaseTopicLocks, StartPorts
from bridge.errors import PortBusyError
from bridge.transport.lock import LockHeldError
from bridge.transport.opener import open_port


@pytest.fixture(autouse=True)
def _alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other tests of this machine have these base topics, too."""
    monkeypatch.setenv(SCOPE_VARIABLE, "test of locks")


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    """A gateway."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def _port(listener: socket.socket) -> str:
    return f"tcp://127.0.0.1:{listener.getsockname()[1]}"


def test_a_base_topic_is_taken_once() -> None:
    """To take it again oneself does no harm; it is free when the block ends."""
    with BaseTopicLocks() as first, BaseTopicLocks() as second:
        first.acquire("house")
        first.acquire("house")
        with pytest.raises(LockHeldError, match="with the base topic house: stop that one first"):
            second.acquire("house")
        second.acquire("house/attic")
    with BaseTopicLocks() as third:
        third.acquire("house")


def test_a_reload_moves_from_one_base_topic_to_another() -> None:
    """The new one is held before the old one is given back."""
    with BaseTopicLocks() as ours, BaseTopicLocks() as other:
        ours.acquire("house")
        ours.acquire("barn")
        for topic in ("house", "barn"):
            with pytest.raises(LockHeldError):
                other.acquire(topic)
        ours.keep("barn")
        other.acquire("house")
        with pytest.raises(LockHeldError):
            other.acquire("barn")


def test_ports_are_held_from_the_start_until_their_lines_close_them(
    listener: socket.socket,
) -> None:
    """The ports of a start stay held until their lines close them; a missing device is no error."""
    url = _port(listener)
    absent = replace(make_line(), id="absent", port="/dev/none")
    with StartPorts() as ports:
        ports.acquire([replace(make_line(), port=url), absent])
        with pytest.raises(PortBusyError):
            open_port(url, 9600)
        with closing(ports.open(url, 9600)), pytest.raises(PortBusyError):
            open_port(url, 9600)
        with closing(ports.open(url, 9600)), pytest.raises(PortBusyError):
            ports.open(url, 9600)


def test_a_port_that_another_program_has_ends_the_start(listener: socket.socket) -> None:
    """The line is named, and nothing stays locked."""
    url = _port(listener)
    free = "tcp://127.0.0.1:1"
    lines = [replace(make_line(), id="barn", port=free), replace(make_line(), port=url)]
    with (
        closing(open_port(url, 9600)),
        pytest.raises(PortBusyError, match=r"line main: tcp://.*: another program"),
        StartPorts() as ports,
    ):
        ports.acquire(lines)
    with StartPorts() as ports:
        ports.acquire(lines)
