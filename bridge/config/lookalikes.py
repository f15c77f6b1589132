"""Characters that look like those of YAML: word processors and web pages insert them."""

from collections.abc import Iterator

from yaml import MappingNode, Mark, Node, ScalarNode, SequenceNode

_SPACE = "type a plain space"
_QUOTE = "type a plain quote, or put plain quotes around the whole text"
_SPACES = {
    "\u00a0": f"a non-breaking space (U+00A0): {_SPACE}",
    "\u202f": f"a narrow non-breaking space (U+202F): {_SPACE}",
    "\u2007": f"a space as wide as a digit (U+2007): {_SPACE}",
    "\u3000": f"an ideographic space (U+3000): {_SPACE}",
    "\u200b": "a space without width (U+200B): remove it",
    "\ufeff": "a byte order mark (U+FEFF): remove it",
}
_QUOTES = {
    mark: f"a curly quote (U+{ord(mark):04X}): {_QUOTE}"
    for mark in ("\u2018", "\u2019", "\u201a", "\u201c", "\u201d", "\u201e")
}
_ALL = _SPACES | _QUOTES
_NEAR = 80  # characters: the context of a misplaced one is at most so long


def in_nodes(root: Node, text: str) -> Iterator[tuple[int, str]]:
    """Yield position and message for each such character that YAML took as part of a word.

    They are allowed inside names, which may be in any language, and anywhere in quotes.
    """
    if _ALL.keys().isdisjoint(text):
        return
    seen: set[int] = set()  # aliases can put a node into several places
    waiting: list[tuple[Node, bool]] = [(root, False)]
    while waiting:
        node, is_key = waiting.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, ScalarNode) and node.style is None:
            yield from _in_scalar(node, text, is_key=is_key)
        elif isinstance(node, SequenceNode):
            waiting += [(item, False) for item in node.value]
        elif isinstance(node, MappingNode):
            waiting += [(one, one is pair[0]) for pair in node.value for one in pair]


def in_lines(text: str, first: Mark, last: Mark) -> tuple[int, int, str] | None:
    """Return line, column and message of the first one on unreadable lines; None: no such."""
    lines = dict(enumerate(text.split("\n")))
    for number in range(max(0, first.line - 1), last.line + 1):
        code = lines.get(number, "").split(" #", 1)[0]
        known = _SPACES if number < first.line else _ALL  # quotes are allowed in a name there
        for at, character in enumerate(code):
            if character in known and _is_misplaced(code, at, "\"'[{,:"):
                return number + 1, at + 1, _ALL[character]
    return None


def _in_scalar(node: ScalarNode, text: str, *, is_key: bool) -> Iterator[tuple[int, str]]:
    start = node.start_mark.index
    written = text[start : node.end_mark.index]
    for at, character in enumerate(written):
        if character in _ALL and (is_key or _is_misplaced(written, at)):
            yield start + at, _ALL[character]
            return


def _is_misplaced(text: str, at: int, signs: str = "") -> bool:
    """Return whether a plain character would have a meaning here: at an end, or beside `signs`."""
    before = text[max(0, at - _NEAR) : at].strip()[-1:]
    after = text[at + 1 : at + _NEAR].strip()[:1]
    if text[at] in _QUOTES:
        return not before or before in signs or (bool(signs) and (not after or after in ",]}:"))
    return not before or not after or before in ":-" or after == "#"
