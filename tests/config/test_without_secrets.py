"""The configuration as it may be shown to others."""

import pytest

from bridge.config.without_secrets import with_secrets, without_secrets
from bridge.errors import ConfigError


@pytest.mark.parametrize(
    "written",
    [
        "password: hunter2",
        'password: "hun, ter2}"',
        "{password: hunter2, host: a}",
        "password: |\n    hunter2\n    more",
        "password: &p hunter2\n  username: *p",
        "token: hunter2",
        "read_token: 'hunter2'",
        "url: mqtts://user:hunter2@broker.example",
    ],
)
def test_no_secret_is_left(written: str) -> None:
    """However YAML lets it be written."""
    text = f"mqtt: {written}\n" if written.startswith("{") else f"mqtt:\n  {written}\n"
    shown = without_secrets(text + "lines: []\n", "config.yaml")
    assert "hun" not in shown
    assert "ter2" not in shown
    assert "lines: []" in shown


def test_where_a_secret_is_may_be_said() -> None:
    """`!env` and `!file` stay, as comments do."""
    text = "mqtt:\n  password: !env WISCO  # mine\n  token: !file /etc/token\n"
    assert without_secrets(text, "config.yaml") == text


def test_hidden_secrets_come_back() -> None:
    """What was hidden is put where it was, whatever else changed; a new one is taken as written."""
    before = "web: {password: 'a: b', token: !env T}\nmqtt:\n  password: hunter2\n"
    shown = without_secrets(before, "config.yaml")
    edited = shown.replace("mqtt:", "mqtt:\n  host: h\n  username: new")

    whole = with_secrets(edited, before, "config.yaml")

    assert whole == before.replace("mqtt:", "mqtt:\n  host: h\n  username: new")


@pytest.mark.parametrize(
    ("edited", "place"),
    [
        ("mqtt: {username: '***'}\n", (1, 18)),
        ("web: {password: '***'}\n", (1, 17)),
        ("mqtt: {url: 'mqtt://***@h'}\n", (1, 21)),
    ],
)
def test_a_secret_that_was_not_there_is_no_secret(edited: str, place: tuple[int, int]) -> None:
    """It is a problem with its place: else the stars would be the password."""
    with pytest.raises(ConfigError) as caught:
        with_secrets(edited, "mqtt: {password: hunter2}\n", "config.yaml")
    assert [(one.line, one.column) for one in caught.value.problems] == [place]
