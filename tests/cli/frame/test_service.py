"""A command that reads the service's configuration finds what the service keeps."""

from pathlib import Path

import pytest

from bridge.cli.frame.service import config_with_state

TEXT = "web: {}\n"


@pytest.fixture(autouse=True)
def shell(monkeypatch: pytest.MonkeyPatch) -> None:
    """No StateDirectory= here: systemd gives that to the service alone."""
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    monkeypatch.setenv("HOME", "/home/pi")


def test_the_configuration_of_the_service_keeps_its_state_where_the_unit_says() -> None:
    """Not in the home of the one that calls the command."""
    config = config_with_state(TEXT, Path("/etc/wisco2mqtt/config.yaml"))
    assert config.state_dir == Path("/var/lib/wisco2mqtt")


def test_any_other_one_is_that_of_a_user() -> None:
    """As `run` does it there."""
    config = config_with_state(TEXT, Path("config.yaml"))
    assert config.state_dir == Path("/home/pi/.local/state/wisco2mqtt")


def test_what_is_written_counts() -> None:
    """`state_dir` of the configuration itself."""
    text = f"{TEXT}state_dir: /srv/state\n"
    config = config_with_state(text, Path("/etc/wisco2mqtt/config.yaml"))
    assert config.state_dir == Path("/srv/state")
