"""Decides why a connection ended, from the words of the broker and the last request. Pure."""

from dataclasses import dataclass

from bridge.mqtt import refusals
from bridge.mqtt.reconnect import Ended, Ending
from bridge.mqtt.refusals import Answer

_WITHOUT_A_WORD = "it closed the connection without a word"
_TLS_ALERT = " alert "  # in the messages of OpenSSL: the other side refused something
_BAD_CREDENTIALS = (0x86, 0x87, 0x8A, 0x8C)


@dataclass(frozen=True, slots=True)
class Blamed:
    """The message that probably ended a connection.

    Attributes:
        left_out: Messages of this size are not sent any more.
    """

    topic: str
    size_bytes: int
    left_out: bool


def refused(answer: Answer) -> Ended:
    """Return the end after the broker refused CONNECT."""
    said = f"it refused us ({answer.text})"
    ending = Ending.CREDENTIALS if answer.code in _BAD_CREDENTIALS else Ending.REFUSED
    if answer.code == refusals.UNSUPPORTED_VERSION:
        ending = Ending.VERSION
    return Ended(ending, said, refusals.advice(answer.code))


def closed_at_connect(error: str | None) -> Ended:
    """Return the end before the broker answered CONNECT."""
    if error is not None and _TLS_ALERT in error:
        return Ended(Ending.REFUSED, error)
    return Ended(Ending.NO_ANSWER, "it closed the connection before it answered CONNECT")


def closed_at_subscribe(said: str | None, asked: int, next_asked: int) -> Ended:
    """Return the end before the broker answered a SUBSCRIBE with `asked` filters."""
    cause = f"{said or _WITHOUT_A_WORD} before it answered SUBSCRIBE with {asked} filters"
    fewer = f"it is asked for {next_asked} at once now"
    advice = fewer if next_asked < asked else "look at its log, and at its access list"
    return Ended(Ending.NOT_SUBSCRIBED, cause, advice)


def closed_over(blamed: Blamed, said: str | None) -> Ended:
    """Return the end at a message that may be too large."""
    cause = f"{said or _WITHOUT_A_WORD} over {blamed.size_bytes} bytes to {blamed.topic!r}"
    after = "none of this size is sent any more" if blamed.left_out else "it is tried once more"
    advice = refusals.advice(refusals.PACKET_TOO_LARGE)
    return Ended(Ending.TOO_LARGE, cause, f"{after}; {advice}")


def closed(answer: Answer, error: str | None, *, by_broker: bool) -> Ended:
    """Return the end of a connection that no request of ours explains."""
    if by_broker:
        return Ended(Ending.LOST, said_of(answer), refusals.advice(answer.code))
    if error is not None:
        return Ended(Ending.LOST, error)
    if answer.code == refusals.UNSPECIFIED:  # the code that paho gives for an end without an error
        return Ended(Ending.HUNG_UP, _WITHOUT_A_WORD)
    return Ended(Ending.LOST, answer.text)


def said_of(answer: Answer) -> str:
    """Return the reason of a DISCONNECT in words."""
    return f"it ended the session ({answer.text})"
