"""Reads text into one tree of YAML nodes. The type of a scalar is decided later, by its key."""

import re

from yaml import BaseLoader, MarkedYAMLError, Node
from yaml.composer import ComposerError
from yaml.reader import ReaderError

from bridge.config import lookalikes
from bridge.errors import ConfigError, Problem

# The schema is 6 levels deep. The limit keeps a page of `[` from using up the stack.
MAX_DEPTH = 20

# Advice on the common errors; most others are wrong indentation.
_ADVICE = {
    "another document": "take the line --- out, and one of the two documents",
    "alias": "put quotes around text that begins with *",
    "'\\t'": "indent with spaces, not with tabs",
    "cannot start any token": "put quotes around text that begins with this character",
    "mapping values": "put quotes around text with a colon in it, or correct the indentation",
}
_OTHER_ADVICE = "look at indentation, brackets and quotes here and on the line before"

# These messages of the YAML reader quote a word that may be a password, without its quotes.
_QUOTED_WORD = re.compile(r"(alias|anchor|handle) '[^']*'")


class _Loader(BaseLoader):
    """Limits the nesting. The base loader takes no word as a number or a boolean."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0

    def compose_node(self, parent: Node | None, index: int) -> Node | None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            place = None if parent is None else parent.start_mark
            raise ComposerError(None, None, "it is nested too deeply", place)
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node


def compose(text: str, file: str, *, example: str = "write it, or name another") -> Node:
    """Return the one document in `text`. `example` is the advice for an empty file.

    Raises:
        ConfigError: It is not YAML, not one document, or empty; with the place.
    """
    try:
        loader = _Loader(text)
    except ReaderError as error:
        raise ConfigError([_bad_character(error, text, file)]) from None
    try:
        node = loader.get_single_node()
    except MarkedYAMLError as error:
        raise ConfigError([_not_yaml(error, text, file)]) from None
    except (ValueError, OverflowError):
        # The scanner does not catch the errors of int() and chr(): `"\UFFFFFFFF"`.
        message = "this cannot be read as YAML: a number or an escape is out of range; correct it"
        mark = loader.get_mark()
        raise ConfigError([Problem(file, mark.line + 1, mark.column + 1, message)]) from None
    if node is None:
        message = f"the file is empty; {example}"
        raise ConfigError([Problem(file, 1, 1, message)])
    if found := sorted(lookalikes.in_nodes(node, text)):
        raise ConfigError([Problem(file, *place_of(text, at), told) for at, told in found])
    return node


def place_of(text: str, index: int) -> tuple[int, int]:
    """Return line and column, counted from 1, of a character."""
    before = text[:index]
    return before.count("\n") + 1, index - before.rfind("\n")


def _bad_character(error: ReaderError, text: str, file: str) -> Problem:
    line, column = place_of(text, error.position)
    code = ord(text[error.position])
    message = f"the control character U+{code:04X} cannot stand in YAML; remove it"
    return Problem(file, line, column, message)


def _not_yaml(error: MarkedYAMLError, text: str, file: str) -> Problem:
    told = ", ".join(part for part in (error.context, error.problem) if part)
    told = _QUOTED_WORD.sub(r"\1", told)
    mark = error.problem_mark
    if mark and (found := lookalikes.in_lines(text, error.context_mark or mark, mark)):
        return Problem(file, *found)
    line, column = (1, 1) if mark is None else (mark.line + 1, mark.column + 1)
    advice = next((_ADVICE[part] for part in _ADVICE if part in told), _OTHER_ADVICE)
    return Problem(file, line, column, f"this cannot be read as YAML: {told}; {advice}")
