"""The JSON Schema of the configuration, judged by a validator of others."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from support.as_editors_read import as_editors_read

from bridge.config.load import config_shape, load_config
from bridge.errors import ConfigError

ROOT = Path(__file__).parents[2]
BAD_FILES = sorted((Path(__file__).parent / "bad").glob("*.yaml"))
SHAPE = json.loads(json.dumps(config_shape({"HOME": "/home/wisco"})))
EDITOR = Draft202012Validator(SHAPE)
# What the reader says of mistakes in the form; each other one lies in what places say together
# (a channel that the model lacks), in ranges of times, in text, or in YAML.
FORM = re.compile(
    r"unknown key|is missing; write|is not known here|is not a boolean"
    r"|must be a (list|map)|is out of range; write (a whole|one of)|has fewer than two"
)


def _texts() -> list[str]:
    """Every valid configuration of the example and the documents."""
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    blocks = [
        block
        for page in pages
        for block in re.findall(r"```yaml\n(.*?)```", page.read_text(), re.DOTALL)
        if "lines:" in block
    ]
    return [(ROOT / "config.example.yaml").read_text(), *(_dedented(block) for block in blocks)]


def _dedented(block: str) -> str:
    indent = len(block) - len(block.lstrip(" "))
    return "\n".join(line[indent:] for line in block.splitlines())


def complaints(text: str) -> list[str]:
    """What an editor marks."""
    document = as_editors_read(text)
    return [error.message for error in EDITOR.iter_errors(document)]


def test_it_is_a_schema() -> None:
    """By the rules of JSON Schema itself."""
    Draft202012Validator.check_schema(SHAPE)


@pytest.mark.parametrize("text", _texts())
def test_an_editor_takes_what_the_bridge_takes(text: str) -> None:
    """The example and every configuration of the documents."""
    assert complaints(text) == []


@pytest.mark.parametrize("path", BAD_FILES, ids=lambda path: str(path.stem))
def test_an_editor_marks_mistakes_of_the_form(path: Path) -> None:
    """And takes a bad file only where no problem of it is one of the form."""
    with pytest.raises(ConfigError) as caught:
        load_config(path, {"HOME": "/home/wisco"})
    try:
        marked = complaints(path.read_text(encoding="utf-8"))
    except (ConfigError, ValueError, RecursionError):
        return  # no YAML: an editor marks that by itself
    of_the_form = [one for one in caught.value.problems if FORM.search(one.message)]
    assert marked or not of_the_form


WITH_PANEL = ("web: {}\n", "web:\n", "web: {}\nlines:\n", "web: {}\nlines: []\n")


@pytest.mark.parametrize("text", WITH_PANEL)
def test_with_a_panel_there_may_be_no_lines(text: str, tmp_path: Path) -> None:
    """They are found there: for the bridge and for an editor."""
    path = tmp_path / "config.yaml"
    path.write_text(text)
    assert load_config(path, {"HOME": "/home/wisco"}).lines == ()
    assert complaints(text) == []


@pytest.mark.parametrize(
    "text",
    ["mqtt: {}\n", "lines:\n", "lines: []\n", "web: {}\nlines: 5\n", "web: {}\nlines: [{}]\n"],
)
def test_without_a_panel_there_are_lines(text: str, tmp_path: Path) -> None:
    """And with one they are written as ever."""
    path = tmp_path / "config.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError):
        load_config(path, {"HOME": "/home/wisco"})
    assert complaints(text) != []


def _keys(shape: Any) -> set[str]:
    if isinstance(shape, list):
        return set().union(*map(_keys, shape), set())
    if not isinstance(shape, dict):
        return set()
    own = set(shape.get("properties", {}))
    return own.union(*(_keys(value) for value in shape.values()))


def test_every_key_of_the_example_is_in_it() -> None:
    """The example shows every key: the schema has each, and no other."""
    example = (ROOT / "config.example.yaml").read_text()
    shown = set(re.findall(r"(?:^|[\s{#,])([a-z_]+):(?=\s|$)", example, re.MULTILINE))
    assert _keys(SHAPE) <= shown
