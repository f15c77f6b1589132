"""Hostile clients of the panel, in full: no frame on the wire, no secret, nothing else slowed."""

import random
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from multiprocessing import get_context
from pathlib import Path

import pytest

from panel.house import PASSWORD, PanelHouse, panel_house

FUZZED, CONNECTIONS, LONG_BYTES = 100_000, 10_000, 100_000_000
READS_KEPT = 0.9  # of the reads of the line go on meanwhile; both processors are busy with us
_HEAD = "POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n{more}\r\n"
_GOOD = b'{"station":"garage","target":"do/1","payload":"ON"}'


@pytest.fixture(name="house", scope="module")
def _locked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PanelHouse]:
    """A house whose panel has a password: whatever comes without it switches nothing."""
    with panel_house(tmp_path_factory.mktemp("locked"), keys=f', password: "{PASSWORD}"') as house:
        yield house


@pytest.fixture(name="kept", autouse=True)
def _kept(house: PanelHouse) -> Iterator[None]:
    """After each: no relay was switched, no secret was logged, the panel and the line live."""
    yield
    assert not any(house.line.module(address).switchings for address in (1, 2))
    assert PASSWORD not in house.daemon.log
    assert "Traceback" not in house.daemon.log
    assert house.daemon.process.poll() is None
    assert b"password" in house.send(_request("/api/command", _GOOD))


def _request(path: str, body: bytes, more: str = "") -> bytes:
    length = "" if "Content-Length" in more else f"Content-Length: {len(body)}\r\n"
    return _HEAD.format(path=path, more=more + length).encode() + body


def _reads_a_second(house: PanelHouse, since: float) -> float:
    """Return how often the bridge asked on the line, by the instants of the requests."""
    asked = [one for one in house.line.log if one.at >= since]
    return len(asked) / 2 / (time.monotonic() - since)


def _quiet(house: PanelHouse) -> float:
    """Return the same with a process beside it that does nothing: the machine is shared."""
    return _elsewhere(_do_nothing, house)


def _do_nothing(_: int) -> None:
    time.sleep(8.0)


def _elsewhere(work: Callable[[int], None], house: PanelHouse) -> float:
    """Do it in a process of its own; return the reads a second of the line meanwhile."""
    began = time.monotonic()
    process = get_context("spawn").Process(target=work, args=(house.web,))
    process.start()
    process.join()
    assert process.exitcode == 0
    return _reads_a_second(house, began)


@pytest.mark.timeout(3600)
def test_bodies_by_chance(house: PanelHouse) -> None:
    """With and without a token that is wrong, at every route that takes a body."""
    chance = random.Random(14)  # noqa: S311  # no secret
    paths = ["/api/command", "/api/check", "/api/login", "/api/scan", "/api/blink", "/api/proposal"]
    began = time.monotonic()
    for number in range(FUZZED):
        body = bytearray(_GOOD)
        for _ in range(chance.randrange(8)):
            body[chance.randrange(len(body))] = chance.randrange(256)
        answer = house.send(_request(paths[number % len(paths)], bytes(body)))
        assert PASSWORD.encode() not in answer
        assert b" 200 " not in answer[:20]
    print(f"{FUZZED} bodies in {time.monotonic() - began:.0f} s: 0 frames, 0 secrets")


def test_bodies_of_100_mb(house: PanelHouse) -> None:
    """They are refused by their head; of one that is sent all the same nothing is kept."""
    before = _rss_mb(house)
    for path in ("/api/command", "/api/login", "/api/check", "/api/config"):
        more = f"Content-Length: {LONG_BYTES}\r\n"
        answer = house.send(_request(path, b"x" * LONG_BYTES, more))
        assert not answer or b" 401 " in answer[:20] or b" 413 " in answer[:20]
    grown = _rss_mb(house) - before
    print(f"bodies of 100 MB: memory grew by {grown:.1f} MB")
    assert grown < 8  # what a thousand tasks leave behind; it does not grow on


def test_ten_thousand_connections(house: PanelHouse) -> None:
    """Opened and left, a thousand at a time; the line goes on."""
    quiet, before, began = _quiet(house), _rss_mb(house), time.monotonic()
    busy = _elsewhere(_open_many, house)
    took_s, grown = time.monotonic() - began - 5.0, _rss_mb(house) - before
    print(
        f"{CONNECTIONS} connections in {took_s:.1f} s: reads a second {quiet:.1f} before, "
        f"{busy:.1f} meanwhile; memory grew by {grown:.1f} MB"
    )
    assert busy > READS_KEPT * quiet
    assert grown < 8  # what a thousand tasks leave behind; it does not grow on


def _open_many(web: int) -> None:
    for _ in range(CONNECTIONS // 1000):
        with ExitStack() as stack:
            for _ in range(1000):
                client = stack.enter_context(socket.socket())
                client.settimeout(5)
                with suppress(OSError):  # it is cut off for a newer one
                    client.connect(("127.0.0.1", web))
                    client.sendall(b"GET /api/events HTTP/1.1\r\n")


def test_slow_heads(house: PanelHouse) -> None:
    """Sixty clients that send a byte a second: the line and others do not notice."""
    quiet, busy = _quiet(house), _elsewhere(_speak_slowly, house)
    print(f"60 slow clients: reads a second {quiet:.1f} before, {busy:.1f} meanwhile")
    assert busy > READS_KEPT * quiet


def _speak_slowly(web: int) -> None:
    with ExitStack() as stack:
        slow = [
            stack.enter_context(socket.create_connection(("127.0.0.1", web))) for _ in range(60)
        ]
        for byte in b"GET / HT":
            for client in slow:
                with suppress(OSError):  # its time was over
                    client.sendall(bytes([byte]))
            time.sleep(1.0)


def _rss_mb(house: PanelHouse) -> float:
    status = Path(f"/proc/{house.daemon.process.pid}/status").read_text()
    line = next(line for line in status.splitlines() if line.startswith("VmRSS:"))
    return int(line.split()[1]) * 1024 / 1e6
