"""The text of a configuration as it may be shown to others: secrets are replaced, all else stays.

`!env NAME` and `!file PATH` stay too: they say where a secret is, and not what.
"""

import re
from collections.abc import Iterator

from yaml import MappingNode, Node, ScalarNode, SequenceNode

from bridge.config.compose import compose

_SECRETS = frozenset({"password", "username", "token", "read_token"})
_PLACES = frozenset({"!env", "!file"})
_HIDDEN = "'***'"
_USER_IN_URL = re.compile(r"(?<=://)[^/\s@'\"]*@")


def without_secrets(text: str, file: str) -> str:
    """Return the text with each secret replaced.

    Raises:
        ConfigError: It is no YAML, so that no one can tell what is secret.
    """
    for start, end in sorted(set(_secret_spans(compose(text, file))), reverse=True):
        text = text[:start] + _HIDDEN + text[end:]
    return _USER_IN_URL.sub("***@", text)


def _secret_spans(node: Node) -> Iterator[tuple[int, int]]:
    if isinstance(node, SequenceNode):
        for item in node.value:
            yield from _secret_spans(item)
    if not isinstance(node, MappingNode):
        return
    for key, value in node.value:
        secret = isinstance(key, ScalarNode) and key.value in _SECRETS
        if secret and value.tag not in _PLACES:
            yield value.start_mark.index, value.end_mark.index
        else:
            yield from _secret_spans(value)
