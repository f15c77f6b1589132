"""YAML nodes with the way to them: what may stand there, and every problem with its place."""

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias, TypeVar

from yaml import MappingNode, Node, ScalarNode, SequenceNode

from bridge.errors import BridgeError, Problem

T = TypeVar("T")
D = TypeVar("D")

MAP_TAG = "tag:yaml.org,2002:map"
SEQUENCE_TAG = "tag:yaml.org,2002:seq"
TEXT_TAG = "tag:yaml.org,2002:str"
ENVIRONMENT_TAG, FILE_TAG = "!env", "!file"
_TAG_OF_HOME_ASSISTANT = "!secret"

_SHOWN_CHARACTERS = 60
_KINDS: dict[type[Node], str] = {
    ScalarNode: "a single value",
    SequenceNode: "a list",
    MappingNode: "a map of keys",
}


class WrongValueError(BridgeError):
    """Describe what stands at one place cannot be taken. Becomes a Problem there.

    Never leaves here.
    """


@dataclass(frozen=True, slots=True)
class Source:
    """One configuration file: what its values may refer to, and where its problems gather."""

    path: Path
    environ: Mapping[str, str] = field(repr=False)
    problems: list[Problem]


@dataclass(frozen=True, slots=True)
class Place:
    """A node and the keys that lead to it, as in `lines[0].stations[1].address`."""

    source: Source
    node: Node
    path: str

    @property
    def line(self) -> int:
        """Return the line in the file, counted from 1."""
        return self.node.start_mark.line + 1

    @property
    def shown(self) -> str:
        """Return what stands here, for messages: what `!env` and `!file` lead to is never shown."""
        if not isinstance(self.node, ScalarNode):
            return _KINDS[type(self.node)]
        tag = f"{self.node.tag} " if self.node.tag in {ENVIRONMENT_TAG, FILE_TAG} else ""
        quote = self.node.style if self.node.style in {"'", '"'} else ""
        return tag + shown(f"{quote}{self.node.value}{quote}")

    def problem(self, message: str) -> None:
        """Add a problem at this place."""
        where = f"{self.path}: " if self.path else ""
        column = self.node.start_mark.column + 1
        problem = Problem(str(self.source.path), self.line, column, where + message)
        self.source.problems.append(problem)

    def child(self, node: Node, step: str) -> "Place":
        """Return the place of a node below this one."""
        path = f"{self.path}{step}" if self.path else step.removeprefix(".")
        return replace(self, node=node, path=path)

    def absent(self, key: str) -> "Place":
        """Stand for a map that was left out: an empty one, so that its defaults apply."""
        node = MappingNode(MAP_TAG, [], self.node.start_mark, self.node.end_mark)
        return self.child(node, f".{key}")

    def read(self, reader: "Reader[T]", default: D) -> T | D:
        """Read what stands here; what cannot be taken is a problem, and `default` goes on."""
        try:
            return reader(self)
        except WrongValueError as error:
            self.problem(str(error))
            return default


Reader: TypeAlias = Callable[[Place], T]


@dataclass(frozen=True, slots=True)
class KeyValue:
    """One key of a map and what stands behind it."""

    key: Place
    value: Place


def shown(text: str) -> str:
    """Make any text fit into one line of a message."""
    clipped = text if len(text) <= _SHOWN_CHARACTERS else text[:_SHOWN_CHARACTERS] + "..."
    return clipped if clipped.isprintable() and clipped.strip() else ascii(clipped)


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Find the known word that was probably meant."""
    by_lower = {option.lower(): option for option in known}
    found = difflib.get_close_matches(word.lower(), by_lower, n=1)
    return by_lower[found[0]] if found else None


def scalar(place: Place, tags: Iterable[str] = ()) -> ScalarNode:
    """Demand a single value that is not empty, with no tag but one of `tags`."""
    node = place.node
    if not isinstance(node, ScalarNode):
        raise WrongValueError(f"must be a single value, not {_KINDS[type(node)]}")
    if node.tag in {ENVIRONMENT_TAG, FILE_TAG} and node.tag not in tags:
        raise WrongValueError(f"{node.tag} can stand only where text is due; write the value")
    _check_tag(node, (TEXT_TAG, *tags))
    if is_empty(node):
        raise WrongValueError("has no value; write one")
    return node


def is_empty(node: Node) -> bool:
    """Tell whether nothing stands behind a key. Quotes with nothing between them are text."""
    return isinstance(node, ScalarNode) and node.value == "" and is_plain(node)


def is_plain(node: ScalarNode) -> bool:
    """Tell whether a scalar stands without quotes and is no block."""
    return node.style is None


def items(place: Place) -> list[Place]:
    """Demand a list and give the places of its items."""
    node = place.node
    if is_empty(node):
        return []
    if not isinstance(node, SequenceNode):
        raise WrongValueError(f"must be a list (lines that begin with -), not {place.shown}")
    _check_tag(node, (SEQUENCE_TAG,))
    return [place.child(item, f"[{index}]") for index, item in enumerate(node.value)]


def entries(place: Place) -> dict[str, KeyValue]:
    """Demand a map and give its entries; keys that cannot be taken are problems."""
    node = place.node
    if is_empty(node):
        return {}
    if not isinstance(node, MappingNode):
        raise WrongValueError(f"must be a map of keys, not {_KINDS[type(node)]}")
    _check_tag(node, (MAP_TAG,))
    found: dict[str, KeyValue] = {}
    for key_node, value_node in node.value:
        key = replace(place, node=key_node)
        name = key.read(_key_name, None)
        if name is None:
            continue
        value = place.child(value_node, f".{shown(name)}")
        first = found.setdefault(name, KeyValue(key, value))
        if first.key is not key:
            key.problem(f"key {shown(name)} stands on line {first.key.line} already; remove one")
    return found


def _key_name(place: Place) -> str:
    # Quotes around a key are fine, also around a channel: JSON is YAML and cannot do without.
    node = place.node
    if not isinstance(node, ScalarNode) or node.tag != TEXT_TAG:
        raise WrongValueError("a key must be a plain word or number")
    if node.value == "<<":
        raise WrongValueError("merge keys (<<) are not taken; write the keys out")
    return str(node.value)


def _check_tag(node: Node, allowed: Iterable[str]) -> None:
    if node.tag in allowed:
        return
    if node.tag == _TAG_OF_HOME_ASSISTANT:
        raise WrongValueError(
            f"{node.tag} is a tag of Home Assistant; write {FILE_TAG} PATH, of a file that holds "
            f"nothing else, or {ENVIRONMENT_TAG} NAME, of a variable"
        )
    # The tag is not repeated: it may be a password that begins with ! and lacks its quotes.
    raise WrongValueError(
        "the word with ! before it is no tag known here; put quotes around text that begins with !"
    )
