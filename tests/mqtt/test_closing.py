import pytest

from bridge.mqtt import closing
from bridge.mqtt.closing import Blamed
from bridge.mqtt.reconnect import Ending
from bridge.mqtt.refusals import Answer, advice


@pytest.mark.parametrize(
    ("code", "ending"),
    [
        (0x84, Ending.VERSION),
        (0x86, Ending.CREDENTIALS),
        (0x85, Ending.REFUSED),
        (0x97, Ending.REFUSED),
        (0x9D, Ending.REFUSED),
    ],
)
def test_a_refused_connect_says_what_to_do(code: int, ending: Ending) -> None:
    """Each reason code has an advice of its own."""
    ended = closing.refused(Answer(code, "its name"))
    assert (ended.ending, ended.cause) == (ending, "it refused us (its name)")
    assert ended.advice == advice(code) != ""


def test_every_reason_that_a_broker_may_have_has_an_advice() -> None:
    """An unknown one too: its log may tell."""
    assert all(advice(code) for code in range(0x80, 0x100))
    assert advice(0xFF) == "look at the broker's log"


def test_a_close_before_suback_is_told_with_what_comes_next() -> None:
    """Fewer filters; at one there is nothing left to try."""
    fewer = closing.closed_at_subscribe(None, 8, 4)
    assert fewer.ending is Ending.NOT_SUBSCRIBED
    assert "asked for 4 at once" in fewer.advice
    assert "access list" in closing.closed_at_subscribe("it ended", 1, 1).advice


@pytest.mark.parametrize(("left_out", "words"), [(False, "once more"), (True, "any more")])
def test_a_close_over_a_message_names_it(*, left_out: bool, words: str) -> None:
    """Topic, size, what follows and what to do."""
    ended = closing.closed_over(Blamed("b/large", 5000, left_out), None)
    assert ended.ending is Ending.TOO_LARGE
    assert "5000 bytes to 'b/large'" in ended.cause
    assert words in ended.advice
    assert "homeassistant.discovery" in ended.advice


def test_a_close_without_a_word_is_a_hang_up() -> None:
    """An error of the socket, and a DISCONNECT, are a loss with a cause."""
    silent = Answer(0x80, "Unspecified error")
    assert closing.closed(silent, None, by_broker=False).ending is Ending.HUNG_UP
    assert closing.closed(silent, "reset", by_broker=False).cause == "reset"
    by_broker = closing.closed(Answer(0x8B, "Server shutting down"), None, by_broker=True)
    assert (by_broker.ending, by_broker.advice) == (Ending.LOST, "it is being stopped")
