"""A configuration as an editor's YAML reader sees it: YAML 1.2, `!env NAME` is text."""

import re
from typing import Any

from yaml import MappingNode, Node, ScalarNode, SequenceNode

from bridge.config.compose import compose

_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}


def as_editors_read(text: str) -> Any:
    """Its values; raises ConfigError where it is no YAML."""
    return _value(compose(text, "config.yaml"))


def _value(node: Node) -> Any:
    if isinstance(node, MappingNode):
        return {key.value: _value(value) for key, value in node.value}
    if isinstance(node, SequenceNode):
        return [_value(item) for item in node.value]
    assert isinstance(node, ScalarNode)
    text = str(node.value)
    if node.style is not None or node.tag.startswith("!"):
        return text
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        return int(text)
    return float(text) if _FLOAT.fullmatch(text) else text
