"""Ids and topics: the text that may become part of an MQTT topic."""

import re

from bridge.config.nodes import Place, WrongValueError
from bridge.config.text import text

MAX_ID_CHARACTERS = 48
MAX_TOPIC_CHARACTERS = 200

_ID = re.compile(r"[a-z0-9]+(?:[_-][a-z0-9]+)*")
_NOT_IN_IDS = re.compile(r"[^a-z0-9]+")


def is_id(word: str) -> bool:
    """Return whether `word` can be an id (docs/configuration.md)."""
    return len(word) <= MAX_ID_CHARACTERS and _ID.fullmatch(word) is not None


def id_from(words: str) -> str:
    """Return an id that resembles a text; empty if no character can be kept."""
    return _NOT_IN_IDS.sub("-", words.lower()).strip("-")[:MAX_ID_CHARACTERS].rstrip("-")


def folded(word: str) -> str:
    """Return an id with `-` and `_` made equal, as in Home Assistant's entity ids."""
    return word.replace("-", "_")


def identifier(place: Place) -> str:
    """Read the id of a line or a station."""
    word = text(place)
    if word == "bridge":
        # B/bridge/... are the bridge's own topics.
        raise WrongValueError("bridge is the bridge's own id; write another")
    if not is_id(word):
        raise WrongValueError(f"{place.shown} cannot be an id; {_advice(word)}")
    return word


def base_topic(place: Place) -> str:
    """Read the base topic of the bridge: ids joined by `/`."""
    topic = text(place)
    if len(topic) > MAX_TOPIC_CHARACTERS or not all(map(is_id, topic.split("/"))):
        raise WrongValueError(
            f"{place.shown} is not made of ids joined by /; write it like wisco or home/wisco"
        )
    return topic


def topic_name(place: Place) -> str:
    """Read a topic of another program: no wildcards, no empty level."""
    topic = text(place)
    if "+" in topic or "#" in topic:
        raise WrongValueError(f"{place.shown} has a wildcard (+ or #); name one topic")
    if not all(topic.split("/")) or len(topic) > MAX_TOPIC_CHARACTERS:
        raise WrongValueError(
            f"{place.shown} has an empty level or is too long; "
            f"write 1 to {MAX_TOPIC_CHARACTERS} characters, no / at the ends or twice in a row"
        )
    return topic


def _advice(word: str) -> str:
    rule = f"a-z and 0-9 joined by single - or _, at most {MAX_ID_CHARACTERS} characters"
    resembling = id_from(word)
    return f"write {resembling} ({rule})" if resembling else f"write {rule}"
