"""What is advised where a library is missing: it works in the form that is installed."""

import shlex
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import pytest

from bridge import installed


@pytest.fixture(autouse=True)
def writable(monkeypatch: pytest.MonkeyPatch) -> None:
    """An environment of the user's own, with pip."""
    monkeypatch.setattr("os.access", lambda *_: True)
    monkeypatch.setattr(installed, "find_spec", lambda _name: object())
    monkeypatch.setattr(installed, "requires", lambda _: ['shtab<2,>=1.13; extra == "cli"'])


def test_an_environment_is_added_to_by_its_own_python() -> None:
    """By the versions that the extra asks for: `wisco2mqtt[cli]` may be on no index."""
    advised = shlex.split(installed.how_to_add("shtab"))
    assert advised == [sys.executable, "-m", "pip", "install", "shtab<2,>=1.13"]


def test_an_environment_of_root_needs_sudo(monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as /opt/wisco2mqtt."""
    monkeypatch.setattr("os.access", lambda *_: False)
    assert installed.how_to_add("shtab").startswith(f"sudo {sys.executable} -m pip install ")


def test_without_pip_uv_does_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Environments of uv have no pip."""
    monkeypatch.setattr(installed, "find_spec", lambda _name: None)
    assert installed.how_to_add("shtab").startswith(f"uv pip install -p {sys.executable} ")


def test_pipx_injects(monkeypatch: pytest.MonkeyPatch) -> None:
    """It owns its environments."""
    monkeypatch.setattr(sys, "prefix", "/root/.local/pipx/venvs/wisco2mqtt")
    assert installed.how_to_add("shtab") == "pipx inject wisco2mqtt 'shtab<2,>=1.13'"


def test_the_debian_package_is_not_added_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """No pip writes into a folder of dpkg."""
    monkeypatch.setattr(installed, "__file__", "/usr/lib/wisco2mqtt/bridge/installed.py")
    assert "the Debian package does not contain it" in installed.how_to_add("amqtt")


def test_a_program_that_was_never_installed_names_the_library(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As `python -m bridge` in a clone."""

    def absent(_name: str) -> Any:
        raise PackageNotFoundError

    monkeypatch.setattr(installed, "requires", absent)
    assert installed.how_to_add("shtab").endswith(" install shtab")


def test_every_extra_that_is_advised_is_one_of_the_project() -> None:
    """What a message names in brackets, pyproject.toml has."""
    root = Path(__file__).parents[1]
    texts = (path.read_text() for path in (root / "bridge").rglob("*.py"))
    assert not [text for text in texts if "wisco2mqtt[" in text]
