"""The files of the page: nothing foreign, nothing inline, every word in two languages."""

import re
from importlib.resources import files

import pytest

STATIC = {one.name: one.read_text() for one in (files("bridge.web") / "static").iterdir()}
SCRIPTS = {name: text for name, text in STATIC.items() if name.endswith(".js")}
TABLE = re.findall(r"^  (\w+): \[(.*?)\],$", SCRIPTS["words.js"], re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("name", STATIC)
def test_nothing_is_fetched_from_elsewhere(name: str) -> None:
    """No other server, and no address from the root: a proxy may put a path in front."""
    text = STATIC[name].replace("http://www.w3.org/2000/svg", "")
    assert not re.search(r"https?://|[\"'(]//", text.replace("rfc2217://host", ""))
    assert not re.search(r"(?:href|src)=\"/|fetch\(\"/|EventSource\(\"/|url\(", text)


@pytest.mark.parametrize("name", STATIC)
def test_text_is_never_taken_as_code(name: str) -> None:
    """Names of modules and messages come from outside."""
    assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write", STATIC[name])
    assert not re.search(r"\beval\(|new Function|\son\w+=\"|\sstyle=\"|javascript:", STATIC[name])


def test_every_word_is_there_in_both_languages() -> None:
    """Two texts in each row, none of them empty, with the same places for values."""
    assert len(TABLE) > 100
    for key, row in TABLE:
        texts = re.findall(r'"([^"]+)"', row)
        assert len(texts) == 2, key
        assert set(re.findall(r"\{\d\}", texts[0])) == set(re.findall(r"\{\d\}", texts[1])), key


def test_every_word_that_is_used_is_in_the_table() -> None:
    """And each of the table is used: by its name, or by one that is put together."""
    known = {key for key, _ in TABLE}
    text = "\n".join(SCRIPTS[name] for name in SCRIPTS if name != "words.js")
    used = set(re.findall(r"\bt\(\"(\w+)\"", text))
    assert used <= known
    put_together = ("why_", "theme_", "kind_", "broker_")
    unused = [
        key
        for key in known - used
        if not key.startswith(put_together) and not re.search(rf"\"{key}\"|\b{key}:", text)
    ]
    of_states = {"opening", "closing", "closed", "stopped", "short", "long", "double"}
    of_verdicts = {"done", "failed", "refused", "unknown"}
    assert set(unused) <= of_states | of_verdicts | {"open", "close", "stop"}
