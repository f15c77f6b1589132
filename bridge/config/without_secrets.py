"""The text of a configuration as it may be shown to others: secrets are replaced, all else stays.

`!env NAME` and `!file PATH` stay too: they say where a secret is, and not what.
"""

import re
from collections.abc import Iterator, Mapping

from yaml import MappingNode, Node, ScalarNode, SequenceNode

from bridge.config.compose import compose, place_of
from bridge.errors import ConfigError, Problem

_SECRETS = frozenset({"password", "username", "token", "read_token"})
_PLACES = frozenset({"!env", "!file"})
HIDDEN = "'***'"
_USER_IN_URL = re.compile(r"(?<=://)[^/\s@'\"]*@")
_HIDDEN_USER = "***@"

_Span = tuple[int, int]


def without_secrets(text: str, file: str) -> str:
    """Return the text with each secret replaced.

    Raises:
        ConfigError: It is no YAML, so that no one can tell what is secret.
    """
    for start, end in _from_the_end(_secret_spans(compose(text, file), "")):
        text = text[:start] + HIDDEN + text[end:]
    return _USER_IN_URL.sub(_HIDDEN_USER, text)


def with_secrets(text: str, before: str, file: str) -> str:
    """Return the text with its secrets: where it has `'***'`, that of `before` is meant.

    Raises:
        ConfigError: It is no YAML, or `before` has no secret there.
    """
    known = _secret_spans(compose(before, file), "")
    spans = _secret_spans(compose(text, file), "")
    hidden = {
        path: (start, end) for path, (start, end) in spans.items() if text[start:end] == HIDDEN
    }
    problems = [
        Problem(file, *place_of(text, start), f"{path}: '***' hides no secret here; write it")
        for path, (start, _) in hidden.items()
        if path not in known
    ]
    users = [
        Problem(file, *place_of(text, found.start()), "the user in this URL is hidden; write it")
        for found in _USER_IN_URL.finditer(text)
        if found[0] == _HIDDEN_USER
    ]
    if problems or users:
        raise ConfigError([*problems, *users])
    secrets = {hidden[path]: before[slice(*known[path])] for path in hidden}
    for start, end in _from_the_end(hidden):
        text = text[:start] + secrets[start, end] + text[end:]
    return text


def _from_the_end(spans: Mapping[str, _Span]) -> list[_Span]:
    """Return the spans in the order in which they can be replaced."""
    return sorted(set(spans.values()), reverse=True)


def _secret_spans(node: Node, path: str) -> dict[str, _Span]:
    """Return where each secret stands, by its path."""
    return dict(_found(node, path))


def _found(node: Node, path: str) -> Iterator[tuple[str, _Span]]:
    if isinstance(node, SequenceNode):
        for index, item in enumerate(node.value):
            yield from _found(item, f"{path}[{index}]")
    if not isinstance(node, MappingNode):
        return
    for key, value in node.value:
        name = str(key.value) if isinstance(key, ScalarNode) else ""
        below = f"{path}.{name}" if path else name
        if name in _SECRETS and value.tag not in _PLACES:
            yield below, (value.start_mark.index, value.end_mark.index)
        else:
            yield from _found(value, below)
