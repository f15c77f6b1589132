"""What browsers that are slow, dead or hostile cost: nothing is switched, and nothing waits."""

import json
import random
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress

import pytest
from support.web_panel import WAIT_S, PanelBench

from bridge.errors import CommandError
from bridge.model import OutputSettings, SettingsRead
from bridge.web.commands import read_wish
from bridge.web.connection import HEAD_WITHIN_S
from bridge.web.server import MOST_CONNECTIONS

HEAD = b"POST /api/command HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"


@pytest.fixture(name="bench")
def _bench() -> Iterator[PanelBench]:
    """A panel that needs no key: the worst case."""
    with PanelBench() as bench:
        yield bench


def _send(bench: PanelBench, data: bytes) -> bytes:
    """Send bytes as they are; return what comes until the panel closes."""
    with socket.create_connection(("127.0.0.1", bench.web.port), timeout=WAIT_S) as client:
        with suppress(OSError):  # the panel may close before it was sent everything
            client.sendall(data)
            client.shutdown(socket.SHUT_WR)
        answer = b""
        try:
            while piece := client.recv(65536):
                answer += piece
        except ConnectionResetError:
            pass
        return answer


@pytest.mark.parametrize(
    "request_",
    [
        b"",
        b"\r\n\r\n",
        b"GET\r\n\r\n",
        b"GET / HTTP\r\n\r\n",
        b"\xff\xfe\xfd\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" * 20,
        b"GET / HTTP/1.1\r\nno colon\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 50_000 + b"\r\n",
        b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"GET /?" + b"a=b&" * 2_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n",
        HEAD + b"Content-Length: 100\r\n\r\n{}",
        HEAD + b"Content-Length: x\r\n\r\n{}",
        HEAD + b"Content-Length: -5\r\n\r\n{}",
        HEAD + b'Transfer-Encoding: chunked\r\n\r\n5\r\n{"a":\r\n',
        b"POST /api/command HTTP/1.1\r\nHost: evil.example\r\n\r\n",
        b"OPTIONS /api/command HTTP/1.1\r\nHost: localhost\r\nOrigin: http://evil.example\r\n\r\n",
        b"HEAD /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"DELETE /api/state HTTP/1.1\r\nHost: localhost\r\n\r\n",
    ],
)
def test_what_is_no_request_ends_quietly(bench: PanelBench, request_: bytes) -> None:
    """An answer or the end of the connection; no line in the log, and the panel works on."""
    answer = _send(bench, request_)
    assert b"Access-Control" not in answer
    assert b"Traceback" not in answer
    assert bench.ask("GET", "/health").status == 200
    assert bench.line.commands == []


def test_a_get_switches_nothing(bench: PanelBench) -> None:
    """Not with any path or query."""
    body = json.dumps({"station": "garage", "target": "do/1", "payload": "ON"})
    for path in ("/api/command", f"/api/command?body={body.replace(' ', '')}", "/api/blink"):
        assert bench.ask("GET", path).status == 405
    assert bench.line.commands == []


def test_connections_that_say_nothing_do_not_shut_others_out(bench: PanelBench) -> None:
    """The oldest of too many is cut off for the newest."""
    with ExitStack() as stack:
        for _ in range(3 * MOST_CONNECTIONS):
            stack.enter_context(socket.create_connection(("127.0.0.1", bench.web.port)))
        began = time.monotonic()
        assert bench.command("garage", "do/1", "ON").document["status"] == "done"
        assert time.monotonic() - began < HEAD_WITHIN_S


def test_browsers_that_never_read_do_not_hold_up_others(bench: PanelBench) -> None:
    """What is new waits in no queue for them."""
    bench.hear(SettingsRead("garage", OutputSettings(pulse=0, hold_ds=(10,) * 8)))
    with ExitStack() as stack:
        for _ in range(5):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", bench.web.port)))
            one.sendall(b"GET /api/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        for number in range(200):
            verdict = bench.command("garage", "do/1", "ON" if number % 2 else "OFF").document
            assert verdict["status"] == "done"


def test_bodies_by_chance_switch_nothing(bench: PanelBench) -> None:
    """Of what is no command by its grammar none comes to the hub."""
    chance = random.Random(14)  # noqa: S311  # no secret
    good = b'{"station":"garage","target":"do/1","payload":"ON"}'
    for _ in range(300):
        body = bytearray(good)
        for _ in range(chance.randrange(1, 6)):
            body[chance.randrange(len(body))] = chance.randrange(256)
        answer = bench.ask("POST", "/api/command", bytes(body))
        taken, bench.line.commands[:] = list(bench.line.commands), []
        if taken:
            document = json.loads(body)
            assert (document["station"], document["target"]) == ("garage", taken[0].target)
            assert document["payload"] == taken[0].payload
        else:
            assert answer.status in {200, 400, 404}


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"null",
        b"[]",
        b"[" * 4000,
        b'{"station": "garage"}',
        b'{"station": "garage", "target": "do/1/set", "payload": "ON"}',
        b'{"station": "garage", "target": "../garage/do/1", "payload": "ON"}',
        b'{"station": "garage/do/1", "target": "set", "payload": "ON"}',
        b'{"station": "bridge", "target": "request/reload", "payload": "ON"}',
        b'{"station": "garage", "target": "do/1", "payload": null}',
        b'{"station": "garage", "target": "do/1", "payload": ["ON"]}',
        b'{"station": "garage", "target": "do/1", "payload": "ON", "payload": "OFF"}',
        b'{"station": "garage", "target": "do", "payload": {"1": "ON", "1": "OFF"}}',
        b'{"station": "garage", "target": "do/1", "payload": "ON", "at": 1e999, "run": "x"}',
    ],
)
def test_what_is_no_command_is_refused(body: bytes) -> None:
    """By its reader, with a reason."""
    with pytest.raises(CommandError):
        read_wish(body, "r")


def test_the_daemon_without_a_panel_holds_nothing_of_it() -> None:
    """Neither the library nor an event loop is in memory."""
    code = (
        "import sys, bridge.cli.run; print([name for name in sys.modules "
        "if name.startswith(('bridge.web', 'microdot', 'asyncio'))])"
    )
    found = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    assert found.stdout == b"[]\n"


def test_the_daemon_holds_nothing_of_what_its_libraries_import_in_vain() -> None:
    """The MQTT library imports what finds proxies, argparse what unpacks; used, they work."""
    code = (
        "import sys\n"
        "from bridge.cli import main\n"
        "main.parse_arguments(['run'])\n"
        "print([name for name in ('email', 'http', 'lzma', 'tempfile') if name in sys.modules])\n"
        "import urllib.request\n"
        "print(urllib.request.Request('http://localhost/').host)"
    )
    found = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    assert found.stdout == b"[]\nlocalhost\n"
