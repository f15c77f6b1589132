"""The bytes that pass a bus are reported once each."""

import pytest
from support.virtual_port import VirtualPort, VirtualTime

from bridge.config.schema import LineConfig
from bridge.errors import NoReplyError
from bridge.model import LineProtocol
from bridge.protocol.wisco import ReadInputsHex
from bridge.transport.bus import Bus
from bridge.transport.timing import LineTiming

READ = ReadInputsHex(4)
REPLY = b"DI>9EAB\r"


class Tapped:
    """A bus, and what was told of it: `>` for what was sent."""

    def __init__(self, *, echo: bool, answers: bool = True) -> None:
        time = VirtualTime()
        begin = READ.frame if echo else b""
        self.port = VirtualPort(time, lambda _: [(0.01, begin + REPLY * answers)])
        line = LineConfig("main", "virtual", 9600, LineProtocol.WISCO, stations=())
        self.bus = Bus(self.port, LineTiming.from_config(line), 0.3, time.clock, time.sleep)
        self.bus.echo = echo
        self.told: list[tuple[str, bytes]] = []
        self.bus.tap(lambda _at, data, sent: self.told.append((">" if sent else "<", data)))

    def whole(self) -> list[tuple[str, bytes]]:
        """Return what was reported, with the parts of a reply joined."""
        pieces: list[tuple[str, bytes]] = []
        for way, data in self.told:
            if pieces and pieces[-1][0] == way == "<":
                pieces[-1] = (way, pieces[-1][1] + data)
            else:
                pieces.append((way, data))
        return pieces


@pytest.mark.parametrize("echo", [False, True])
def test_a_request_and_its_reply_are_told_once(echo: bool) -> None:
    """Request and reply are reported once, also if the adapter echoes."""
    tapped = Tapped(echo=echo)
    assert tapped.bus.exchange(READ, protected=False) == 0x9EAB
    assert tapped.whole() == [(">", READ.frame), ("<", REPLY)]


@pytest.mark.parametrize("echo", [False, True])
def test_what_came_unasked_is_told(echo: bool) -> None:
    """Unsolicited bytes are reported."""
    tapped = Tapped(echo=echo)
    tapped.port.arrive(1000.0, b"noise")
    assert tapped.bus.listen() == b"noise"
    assert tapped.told == [("<", b"noise")]


def test_listening_for_a_while_hears_what_comes_meanwhile() -> None:
    """Bytes that come during `listen` are reported, and later ones are not."""
    tapped = Tapped(echo=False)
    tapped.port.arrive(1000.1, b"soon")
    assert tapped.bus.listen(0.2) == b"soon"
    assert tapped.bus.counters.unsolicited_bytes == 4


def test_an_echo_that_is_not_ours_is_told() -> None:
    """An echo that differs from our frame is reported, as evidence."""
    tapped = Tapped(echo=True, answers=False)
    with pytest.raises(NoReplyError):
        tapped.bus.exchange(READ, protected=False)
    tapped.port.arrive(tapped.port.time.now + 1, b"#0")
    tapped.port.time.sleep(2)
    tapped.bus.listen()
    assert tapped.whole() == [(">", READ.frame), ("<", b"#0")]


def test_nothing_is_told_when_nobody_listens_any_more() -> None:
    """The bus has its own port again."""
    tapped = Tapped(echo=False)
    tapped.bus.tap(None)
    tapped.bus.exchange(READ, protected=False)
    assert tapped.told == []
    tapped.bus.close()
    assert tapped.port.closed == 1
