"""The turn in which the servers of a cluster are tried. No network: a table stands in for names."""

from bridge.config.schema import Server
from bridge.mqtt.servers import Candidate, ServerTurn, addresses_of

A, B = Server("a", 1883), Server("b", 1884)
TABLE = {A: ["10.0.0.1"], B: ["10.0.0.2", "fd00::2"]}
A1, B1, B2 = (Candidate(s, address) for s in (A, B) for address in TABLE[s])


def turn() -> ServerTurn:
    """Two servers, of which the second has two addresses."""
    return ServerTurn((A, B), TABLE.__getitem__)


def test_each_address_of_each_server_is_tried_once_in_a_round() -> None:
    """A round has three addresses, and the fourth attempt begins the next round."""
    servers = turn()
    tried = [(servers.next(), servers.has_more) for _ in range(4)]
    assert tried == [(A1, True), (B1, True), (B2, False), (A1, True)]


def test_the_one_that_worked_last_is_tried_first() -> None:
    """After B's second address took us, the next round begins with it."""
    servers = turn()
    last = [servers.next() for _ in range(3)][-1]
    servers.worked(last)
    assert not servers.has_more
    assert [servers.next() for _ in range(3)] == [B2, A1, B1]


def test_a_name_that_cannot_be_looked_up_is_tried_by_its_name() -> None:
    """It is one candidate without an address: the connection tells what is wrong with it."""
    servers = ServerTurn((A,), lambda _server: [])
    assert servers.next() == Candidate(A, None)
    assert not servers.has_more


def test_a_mute_server_is_left_for_one_that_may_speak() -> None:
    """The mute one comes last in the next round."""
    servers = turn()
    first = servers.next()
    servers.worked(first)
    assert servers.leave(first, was_good=False)
    assert [servers.next() for _ in range(3)] == [B1, B2, A1]


def test_where_every_server_is_mute_the_last_is_kept_for_a_while() -> None:
    """The last one is kept when asked the first time, and left when asked the second time."""
    servers = turn()
    left = []
    for candidate in (A1, B1, B2):
        assert servers.next() == candidate
        servers.worked(candidate)
        left.append(servers.leave(candidate, was_good=False))
    assert left == [True, True, False]
    assert servers.leave(B2, was_good=False)


def test_a_server_that_worked_for_long_is_left_at_once_when_it_gets_mute() -> None:
    """That others were mute an hour ago says nothing about now."""
    servers = turn()
    for candidate in (servers.next(), servers.next()):
        servers.leave(candidate, was_good=False)
    assert servers.leave(servers.next(), was_good=True)


def test_a_lonely_server_is_never_left() -> None:
    """There is nothing better to be had."""
    servers = ServerTurn((A,), TABLE.__getitem__)
    candidate = servers.next()
    assert not any(servers.leave(candidate, was_good=good) for good in (False, True, False))


def test_the_resolver_of_the_system_is_asked() -> None:
    """An address is its own name, and a name that cannot be has none."""
    assert addresses_of(Server("127.0.0.1", 1)) == ["127.0.0.1"]
    assert addresses_of(Server("a" * 300, 1)) == []
