"""`!env` and `!file`: where credentials come from, and that they are never shown."""

from pathlib import Path

import pytest
from support.config_file import file_with, load_text, problems_of

from bridge.config.text import MAX_CHARACTERS

SECRET = "hunter2"  # noqa: S105 -- the tests look for it where it must not be


def _with_password(value: str) -> str:
    return file_with(top=f"mqtt:\n  username: wisco\n  password: {value}")


def test_a_password_may_stand_in_the_environment(tmp_path: Path) -> None:
    """`!env NAME` takes the variable as it is."""
    config = load_text(tmp_path, _with_password("!env SECRET"), SECRET=SECRET)

    assert config.mqtt.password == SECRET


@pytest.mark.parametrize(
    ("content", "password"),
    [
        ("hunter2", "hunter2"),
        ("hunter2\n", "hunter2"),
        ("hunter2\r\n", "hunter2"),
        (" hunter2 ", " hunter2 "),
        ("รหัส", "รหัส"),
    ],
)
def test_a_password_may_stand_in_a_file(tmp_path: Path, content: str, password: str) -> None:
    """`!file PATH` drops one line break at the end, and nothing else."""
    (tmp_path / "secret").write_bytes(content.encode())

    assert load_text(tmp_path, _with_password("!file secret")).mqtt.password == password
    absolute = _with_password(f"!file {tmp_path}/secret")
    assert load_text(tmp_path, absolute).mqtt.password == password


def test_other_text_may_come_from_elsewhere_too(tmp_path: Path) -> None:
    """A port, a host: what differs from machine to machine."""
    text = file_with(top="mqtt: {host: !env BROKER}")

    assert load_text(tmp_path, text, BROKER="10.0.0.5").mqtt.host == "10.0.0.5"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"hunter2\n\n", "has the control character U+000A at 8"),
        (b"hunter2\xff", "!file secret is not UTF-8 text"),
        (b"\n", "is empty"),
        (b"hunter2" * MAX_CHARACTERS, "is longer than"),
    ],
)
def test_a_file_that_holds_no_password_is_a_problem(
    tmp_path: Path, content: bytes, told: str
) -> None:
    """The message names the file, never what it holds."""
    (tmp_path / "secret").write_bytes(content)
    (problem,) = problems_of(tmp_path, _with_password("!file secret"))

    assert "mqtt.password: " in problem
    assert told in problem
    assert SECRET not in problem


def test_an_empty_variable_is_a_problem(tmp_path: Path) -> None:
    """A credential that was not handed over leaves an empty variable behind."""
    (problem,) = problems_of(tmp_path, _with_password("!env SECRET"), SECRET="")

    assert "!env SECRET names a variable that is empty" in problem


@pytest.mark.parametrize("value", ["!env", "!file", '!env "\\0"', '!file "\\ud800"'])
def test_a_tag_without_a_usable_name_is_a_problem(tmp_path: Path, value: str) -> None:
    """Names that no system call would take."""
    (problem,) = problems_of(tmp_path, _with_password(value))

    assert "mqtt.password: has " in problem


@pytest.mark.parametrize(
    "top",
    [
        "mqtt: {base_topic: !env SECRET}",
        "mqtt: {host: !env SECRET}",
        "mqtt: {url: !env SECRET}",
        "mqtt: {protocol: !env SECRET}",
        "mqtt: {tls: {ca: !env SECRET}}",
        "mqtt: {username: wisco, password: {a: !env SECRET}}",
        "homeassistant: {status_topic: !env SECRET, configuration_url: !env SECRET}",
    ],
)
def test_what_came_from_elsewhere_is_in_no_message(tmp_path: Path, top: str) -> None:
    """A secret at a wrong key is in no message: messages show the name of the variable."""
    told = problems_of(tmp_path, file_with(top=top), SECRET=f"{SECRET}+#/: ")

    assert told
    assert SECRET not in "".join(told)


@pytest.mark.parametrize(
    "value",
    [
        "*hunter2",
        "!hunter2",
        "!hunter2! x",
        "&hunter2 [&hunter2 x, &hunter2 y]",
        "%hunter2",
        "@hunter2",
        "[hunter2]",
        "{hunter2: 1}",
        "'hunter2",
        '"hunter2\\q"',
        "hunter2: x",
        '"hunter2\\n"',
    ],
)
def test_a_password_that_lacks_its_quotes_is_in_no_message(tmp_path: Path, value: str) -> None:
    """YAML has a meaning for many first characters, and its reader quotes what it met."""
    told = problems_of(tmp_path, _with_password(value))

    assert told
    assert SECRET not in "".join(told)


def test_the_password_is_in_no_repr(tmp_path: Path) -> None:
    """A configuration may stand in a log."""
    assert SECRET not in repr(load_text(tmp_path, _with_password(SECRET)))
