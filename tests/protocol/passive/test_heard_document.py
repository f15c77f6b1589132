"""Heard pieces as JSON, and back."""

import json

import pytest
from support import replies

from bridge.protocol.passive.heard_document import heard_document, read_heard
from bridge.protocol.passive.listener import Heard, Listener

READ = bytes.fromhex("01 02 00 00 00 10 79 C6")
REPLY = replies.rtu(1, 2, 2, 4, 0)
REFUSAL = replies.rtu(1, 0x82, 1)


def heard(*pieces: bytes) -> list[Heard]:
    """Return what a listener hears in pieces that come a second apart."""
    listener = Listener()
    found = [one for n, piece in enumerate(pieces) for one in listener.hear(piece, n * 0.6)]
    return found + listener.pass_time(100.0)


@pytest.mark.parametrize(
    "pieces",
    [
        (READ, REPLY),
        (READ, REFUSAL),
        (READ, READ),
        (b"#01RDIH\r", b"DI>0004\r"),
        (b"#01RDIH\r", b"ERR=1\r"),
        (b"#01RDIH\r", b"\xff\x00"),
        (REPLY,),
    ],
)
def test_all_of_it_comes_back(pieces: tuple[bytes, ...]) -> None:
    """Requests, replies, refusals, silence and noise, through JSON."""
    for one in heard(*pieces):
        document = json.loads(json.dumps(heard_document(one)))
        assert heard_document(read_heard(document, one.at)) == heard_document(one)
        again = read_heard(document, one.at)
        assert (again.refused, again.unanswered) == (one.refused, one.unanswered)


@pytest.mark.parametrize(
    "change",
    [
        {"direction": "sideways"},
        {"bytes": "0"},
        {"station": "one"},
        {"protocol": "telnet"},
        {"gap_ms": "soon"},
    ],
)
def test_anything_else_is_no_document(change: dict[str, str]) -> None:
    """A stranger may write to any topic."""
    document = heard_document(heard(READ)[0])
    with pytest.raises(ValueError, match="nothing that was heard"):
        read_heard({**document, **change}, 0.0)
    with pytest.raises(ValueError, match="nothing that was heard"):
        read_heard({}, 0.0)
