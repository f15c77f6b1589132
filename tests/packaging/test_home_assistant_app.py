"""The app of Home Assistant: from the Supervisor's answer and the options to a valid start."""

import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import pytest
import yaml
from support.supervisor import TOKEN, supervisor

from bridge.cli.main import parse_arguments
from bridge.config.load import load_config
from bridge.files import replace_file

APP = Path(__file__).parents[2] / "packaging" / "home-assistant" / "wisco2mqtt"
BROKER = {"host": "core-mosquitto", "port": 1884, "username": "addons", "password": "s3cret"}
OPTIONS = {"panel_password": "open sesame", "log_level": "warning"}


class Started(BaseException):
    """What the start script became; as `exec` it does not return."""

    def __init__(self, command: tuple[str, ...], environ: Mapping[str, str]) -> None:
        super().__init__(command)
        self.command = command
        self.environ = environ


@dataclass(frozen=True)
class Box:
    """The container: its two folders."""

    data: Path
    config: Path

    def start(self, supervisor: str) -> Started:
        """Runs the start script."""
        spec = spec_from_file_location("app_start", APP / "start.py")
        assert spec is not None
        assert spec.loader is not None
        script = module_from_spec(spec)
        spec.loader.exec_module(script)
        with pytest.raises(Started) as started:
            script.main(self.data, self.config, supervisor)
        return started.value


@pytest.fixture
def box(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Box:
    """Before its first start."""

    def become(_name: str, command: tuple[str, ...], environ: Mapping[str, str]) -> None:
        raise Started(command, environ)

    monkeypatch.setattr(os, "execvpe", become)
    monkeypatch.setenv("SUPERVISOR_TOKEN", TOKEN)
    (tmp_path / "options.json").write_text(json.dumps(OPTIONS))
    return Box(tmp_path, tmp_path / "config.yaml")


def test_the_first_start_has_the_broker_and_an_empty_house(box: Box) -> None:
    """What runs is a command line of ours, with a configuration that holds no secret."""
    with supervisor(200, {"result": "ok", "data": BROKER}) as url:
        started = box.start(url)
    command, args = parse_arguments(started.command[1:])
    assert (command.NAME, args.log_level) == ("run", "warning")
    config = load_config(args.config, started.environ)
    assert (config.mqtt.host, config.mqtt.port) == ("core-mosquitto", 1884)
    assert (config.mqtt.username, config.mqtt.password) == ("addons", "s3cret")
    assert config.web is not None
    assert config.web.password == OPTIONS["panel_password"]
    assert (config.lines, config.state_dir) == ((), box.data)
    text = box.config.read_text()
    assert not [secret for secret in ("addons", "s3cret", "sesame") if secret in text]


def test_a_later_start_leaves_the_configuration_alone(box: Box) -> None:
    """It is the owner's; only the secrets come anew."""
    box.config.write_text("mine\n")
    with supervisor(200, {"result": "ok", "data": {**BROKER, "password": "new"}}) as url:
        started = box.start(url)
    assert box.config.read_text() == "mine\n"
    assert started.environ["WISCO_MQTT_PASSWORD"] == "new"  # noqa: S105  # a stub's


@pytest.mark.parametrize("answer", [(400, {"result": "error"}), (200, {"odd": 1}), (200, {})])
def test_without_a_broker_it_starts_all_the_same(
    box: Box, answer: tuple[int, dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    """With the panel; one line says what to write."""
    with supervisor(*answer) as url:
        started = box.start(url)
    config = load_config(box.config, started.environ)
    assert (config.mqtt.host, config.mqtt.username) == ("core-mosquitto", None)
    assert capsys.readouterr().err.count("\n") == 1


def test_a_broker_with_tls_is_reached_so(box: Box) -> None:
    """As the Supervisor says."""
    with supervisor(200, {"result": "ok", "data": {**BROKER, "ssl": True}}) as url:
        started = box.start(url)
    assert load_config(box.config, started.environ).mqtt.tls is not None


def test_every_option_has_a_schema_a_default_and_words_in_each_language() -> None:
    """Home Assistant shows what has no words by its key."""
    app = yaml.safe_load((APP / "config.yaml").read_text())
    assert app["schema"].keys() == app["options"].keys() == OPTIONS.keys()
    for path in (APP / "translations").iterdir():
        words = yaml.safe_load(path.read_text())
        assert words["configuration"].keys() == OPTIONS.keys()
        assert words["network"].keys() == app["ports"].keys()


def test_its_apparmor_profile_is_one_that_the_supervisor_takes() -> None:
    """One profile, named as the app: the Supervisor gives it the name of the installed one."""
    slug = yaml.safe_load((APP / "config.yaml").read_text())["slug"]
    text = (APP / "apparmor.txt").read_text()
    assert re.findall(r"^profile ([^ ]+).*$", text, re.MULTILINE) == [slug]
    written = set(re.findall(r"^  (/\S+) rwk,$", text, re.MULTILINE))
    assert {"/data/**", "/config/**"} <= written


def test_a_backup_leaves_out_what_is_there_for_a_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The Supervisor gives up a backup of which a file vanishes before it is read."""
    there: list[Path] = []
    monkeypatch.setattr(os, "fsync", lambda _: there.extend(tmp_path.iterdir()))
    replace_file(tmp_path / "config.yaml", b"lines: []\n")
    exclude = yaml.safe_load((APP / "config.yaml").read_text())["backup_exclude"]
    gone = {path for path in there if not path.exists()}
    assert gone
    assert all(any(path.match(pattern) for pattern in exclude) for path in gone)
    assert not any((tmp_path / "config.yaml").match(pattern) for pattern in exclude)
