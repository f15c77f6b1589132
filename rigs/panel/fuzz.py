"""`python -m panel.fuzz 100000`: requests by chance with a key, to the real bridge.

The client knows the token, or the one that only looks. A request that is a command after all is
told apart by a reader of its own: no other may write to a module.
"""

import json
import random
import re
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from panel.house import PASSWORD, PanelHouse, panel_house

TOKEN, READ_TOKEN = "t0ken of a program", "t0ken of eyes"  # of a house that is not there
_KEYS = f', password: "{PASSWORD}", token: "{TOKEN}", read_token: "{READ_TOKEN}"'
_SECRETS = tuple(one.encode() for one in (PASSWORD, TOKEN, READ_TOKEN))
_TEXT = "mqtt: {host: broker.lan, password: '***'}\nlines: []\nweb: {password: '***'}\n"
_GARAGE = {"station": "garage", "target": "do/1", "payload": "ON"}
_GOOD: tuple[tuple[str, str, Any], ...] = (
    ("POST", "/api/command", _GARAGE),
    ("POST", "/api/command", {**_GARAGE, "id": "x1", "deadline": 2.0}),
    ("POST", "/api/command", {**_GARAGE, "target": "do", "payload": {"1": "ON", "8": "OFF"}}),
    ("POST", "/api/command", {**_GARAGE, "target": "do/8/mode", "payload": "latch"}),
    ("POST", "/api/command", {**_GARAGE, "target": "do/8/hold", "payload": 0.5}),
    ("POST", "/api/command", {**_GARAGE, "target": "cover/shutter", "payload": "STOP"}),
    ("POST", "/api/check", {"text": _TEXT}),
    ("PUT", "/api/config", {"text": _TEXT, "version": "0" * 32}),
    ("POST", "/api/scan", {"port": "/dev/there-is-none", "thorough": False}),
    ("POST", "/api/blink", {"address": 1, "output": 1}),
    ("POST", "/api/proposal", {"names": {"1": {"id": "hall", "inputs": {"1": "Door"}}}}),
    ("POST", "/api/trace", {"line": "main", "for_s": 1}),
    ("POST", "/api/backup", {}),
    ("GET", "/api/backup", None),
    ("GET", "/api/config", None),
    ("GET", "/api/state", None),
    ("GET", "/metrics", None),
)
_TARGETS = re.compile(r"do(/[1-8](/(mode|hold))?)?|cover/shutter(/position)?")
_WORDS = {"ON", "OFF", "TOGGLE", "PRESS", "latch", "pulse", "OPEN", "CLOSE", "STOP"}
_METHODS = ("GET", "POST", "PUT", "DELETE", "HEAD", "OPTIONS", "PATCH", "post", "")
_PIECES = (
    b"/..",
    b"%2e%2e",
    b"%00",
    b"//",
    b"?",
    b"#",
    b"\\",
    b"\xff",
    b"%",
    b";",
    b"[",
    b'"',
    b"{",
)
_GOOD_EACH = 500  # so often a request as it should be: else it is not known whether any arrives


def fuzz(house: PanelHouse, key: str, count: int, seed: int) -> Counter[str]:
    """Send so many requests; return how many had each status, and how many wrote, and might."""
    chance = random.Random(seed)  # noqa: S311  # no secret
    told: Counter[str] = Counter()
    written = _written(house)
    for number in range(count):
        method, path, body = _request(chance, is_good=number % _GOOD_EACH == 0)
        answer = house.send(_bytes(method, path, body, key))
        before, written = written, _written(house)
        might = key == TOKEN and is_command(method, path, body)
        assert written == before or might, (method, path, body)
        assert b"Traceback" not in answer, (method, path, body)
        assert not [one for one in _SECRETS if one in answer], (method, path, body)
        status = answer[9:12].decode("ascii", "replace") or "none"
        assert status != "500", (method, path, body, answer)
        told.update((status, *(["might write"] if might else [])))
        told["wrote"] += written != before
    assert house.daemon.process.poll() is None
    assert "Traceback" not in house.daemon.log
    assert not [one for one in _SECRETS if one.decode() in house.daemon.log]
    return told


def is_command(method: str, path: bytes, body: bytes) -> bool:
    """Return whether a request may be a command by its grammar, whatever the bridge says of it."""
    where = unquote(re.split(rb"[?#]", path)[0].decode("latin-1"))
    if method.upper() != "POST" or where != "/api/command":
        return False
    try:
        document = json.loads(body)
    except (ValueError, RecursionError):
        return False
    if not isinstance(document, dict) or document.get("station") not in ("garage", "pumps"):
        return False
    target, payload = document.get("target"), document.get("payload")
    words = list(payload.values()) if isinstance(payload, dict) else [payload]
    are_words = all(isinstance(one, int | float) or one in _WORDS for one in words if one != [])
    return isinstance(target, str) and bool(_TARGETS.fullmatch(target)) and are_words


def _written(house: PanelHouse) -> int:
    """Return how many orders to outputs and to memory came in frames."""
    modules = [house.line.module(address) for address in (1, 2)]
    return sum(module.ordered.total() + module.eeprom_writes for module in modules)


def _request(chance: random.Random, *, is_good: bool) -> tuple[str, bytes, bytes]:
    method, path_text, document = chance.choice(_GOOD[:1] if is_good else _GOOD)
    path, body = path_text.encode(), b"" if document is None else json.dumps(document).encode()
    if is_good:
        return method, path, body
    match chance.randrange(8):
        case 0:
            path = _changed(chance, path, 4)
        case 1:
            method = chance.choice(_METHODS)
        case _ if not body:
            path = _changed(chance, path, 1)
    return method, path, _changed(chance, body, 8) if body else body


def _changed(chance: random.Random, data: bytes, most: int) -> bytes:
    """Return it with some bytes replaced, left out, put in or repeated."""
    made = bytearray(data)
    for _ in range(chance.randint(1, most)):
        at = chance.randrange(len(made) + 1)
        end = min(len(made), at + chance.randrange(1, 6))
        match chance.randrange(5):
            case 0:
                made[at : at + 1] = bytes([chance.randrange(256)])
            case 1:
                del made[at:end]
            case 2:
                made[at:at] = chance.choice(_PIECES)
            case 3:
                made[at:at] = bytes([chance.randrange(32, 127)])
            case _:
                made[at:at] = made[at:end]
    return bytes(made)


def _bytes(method: str, path: bytes, body: bytes, key: str) -> bytes:
    path = re.sub(rb"[\r\n ]", b"", path)  # else it is another request
    head = (
        f"Host: localhost\r\nAuthorization: Bearer {key}\r\n"
        f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
    )
    return method.encode() + b" " + path + b" HTTP/1.1\r\n" + head.encode() + body


def run(directory: Path, count: int, seed: int) -> None:
    """Ask with each key, and print what came of it."""
    for name, key in (("a token", TOKEN), ("a token that looks", READ_TOKEN)):
        with panel_house(directory / name.replace(" ", "-"), keys=_KEYS) as house:
            began = time.monotonic()
            told = fuzz(house, key, count, seed)
        print(
            f"{name}: {count} requests in {time.monotonic() - began:.0f} s, seed {seed}: "
            f"{told['might write']} might write by their grammar, {told['wrote']} wrote; "
            f"0 others did, 0 secrets; by status {dict(sorted(told.items()))}",
            flush=True,
        )
        assert bool(told["wrote"]) is (key == TOKEN)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        run(Path(folder), int(sys.argv[1]) if sys.argv[1:] else 100_000, random.randrange(10_000))  # noqa: S311
