"""Adds a line to the text of a configuration, and leaves all else in it as it is."""

from collections.abc import Callable, Sequence

from yaml import MappingNode, Node, ScalarNode, SequenceNode

from bridge.config.compose import compose
from bridge.errors import BridgeError

_INDENT = 2  # of the item that is added


def with_line(text: str, section: Callable[[str], Sequence[str]]) -> str:
    """Return the text with one more item of `lines`.

    Args:
        text: A configuration, which may have no `lines`.
        section: Makes the item, line by line, of the id that the line gets.

    Raises:
        ConfigError: The text is no YAML.
        BridgeError: Its `lines` are not written in a way to add one.
    """
    root = compose(text, "config.yaml")
    if not isinstance(root, MappingNode) or root.flow_style:
        raise BridgeError("the configuration is no map of keys, one on each line")
    found = {key.value: (key, value) for key, value in root.value if isinstance(key, ScalarNode)}
    if "lines" not in found:
        return "\n".join([text.rstrip("\n"), "", "lines:", *section("main"), ""])
    key, value = found["lines"]
    if not value.value:
        block = "\n".join(["lines:", *section("main")])
        return text[: key.start_mark.index] + block + text[value.end_mark.index :]
    if not isinstance(value, SequenceNode) or value.flow_style:
        raise BridgeError(
            "lines is not written as a list with - on lines of its own: do that first"
        )
    return _in_front(text, value, section)


def _in_front(text: str, lines: SequenceNode, section: Callable[[str], Sequence[str]]) -> str:
    """Add it in front of the others: where the last one ends, comments may follow."""
    ids = {_id_of(item) for item in lines.value}
    line_id = next(name for n in range(2, 100) if (name := f"line{n}") not in ids)
    column, start = lines.start_mark.column, lines.start_mark.index - lines.start_mark.column
    added = [" " * column + line[_INDENT:] for line in section(line_id)]
    return text[:start] + "\n".join(added) + "\n" + text[start:]


def _id_of(item: Node) -> str | None:
    if not isinstance(item, MappingNode):
        return None
    ids = [value.value for key, value in item.value if key.value == "id"]
    return str(ids[0]) if ids else None
