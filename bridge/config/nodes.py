"""YAML nodes with their path: values are read here, and every problem gets its place."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

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
    """A value that cannot be used.

    It becomes a Problem at its place; it never leaves this package.
    """


@dataclass(frozen=True, slots=True)
class Source:
    """One configuration file: what its values may refer to, and where its problems gather.

    Attributes:
        secrets: Whether secrets are read that stand elsewhere (`!env`, `!file`).
        shapes: By path, the forms of maps that were read, where those are asked for.
    """

    path: Path
    environ: Mapping[str, str] = field(repr=False)
    problems: list[Problem]
    secrets: bool = True
    shapes: dict[str, Mapping[str, Any]] | None = None


@dataclass(frozen=True, slots=True)
class Place:
    """A node and the path of keys to it, such as `lines[0].stations[1].address`."""

    source: Source
    node: Node
    path: str

    @property
    def line(self) -> int:
        """Return the line in the file, counted from 1."""
        return self.node.start_mark.line + 1

    @property
    def shown(self) -> str:
        """Return the text for messages; the values behind `!env` and `!file` are never shown."""
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
        """Return the place of a map that was left out: an empty map, so that its defaults apply."""
        node = MappingNode(MAP_TAG, [], self.node.start_mark, self.node.end_mark)
        return self.child(node, f".{key}")

    def read(self, reader: "Reader[T]", default: D) -> T | D:
        """Return the value here; if it is wrong, add a problem and return `default`."""
        try:
            return reader(self)
        except WrongValueError as error:
            self.problem(str(error))
            return default


Reader: TypeAlias = Callable[[Place], T]


@dataclass(frozen=True, slots=True)
class KeyValue:
    """One key of a map and its value."""

    key: Place
    value: Place


def shown(text: str) -> str:
    """Return a text shortened to fit into one line of a message."""
    clipped = text if len(text) <= _SHOWN_CHARACTERS else text[:_SHOWN_CHARACTERS] + "..."
    return clipped if clipped.isprintable() and clipped.strip() else ascii(clipped)


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that was probably meant."""
    # Only a mistake needs it: a bridge that runs would keep 240 KiB for it.
    import difflib  # noqa: PLC0415

    by_lower = {option.lower(): option for option in known}
    found = difflib.get_close_matches(word.lower(), by_lower, n=1)
    return by_lower[found[0]] if found else None


def scalar(place: Place, tags: Iterable[str] = ()) -> ScalarNode:
    """Return a single value that is not empty, with no tag except one of `tags`."""
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
    """Return whether a key has no value. Empty quotes are a value."""
    return isinstance(node, ScalarNode) and node.value == "" and is_plain(node)


def is_plain(node: ScalarNode) -> bool:
    """Return whether a scalar has no quotes and is no block."""
    return node.style is None


def items(place: Place) -> list[Place]:
    """Return the places of the items of a list."""
    node = place.node
    if place.source.shapes is not None:
        return [place.child(node, "[0]")]
    if is_empty(node):
        return []
    if not isinstance(node, SequenceNode):
        raise WrongValueError(f"must be a list (lines that begin with -), not {place.shown}")
    _check_tag(node, (SEQUENCE_TAG,))
    return [place.child(item, f"[{index}]") for index, item in enumerate(node.value)]


def entries(place: Place) -> dict[str, KeyValue]:
    """Return the entries of a map; a key that cannot be used is a problem."""
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
    # Quotes around a key are allowed, also around a channel: JSON is YAML and needs them.
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
    # The tag is not shown: it may be a password that begins with ! and has no quotes.
    raise WrongValueError(
        "the word with ! before it is no tag known here; put quotes around text that begins with !"
    )
