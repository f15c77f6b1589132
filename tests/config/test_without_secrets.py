"""The configuration as it may be shown to others."""

import pytest

from bridge.config.without_secrets import without_secrets


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
