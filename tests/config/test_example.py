"""`config.example.yaml`: valid as it stands, valid with everything in it, and complete."""

import re
from pathlib import Path

import pytest
from support.config_file import load_text

from bridge.config.load import load_config
from bridge.config.schema import Config
from bridge.config.tables import Table

EXAMPLE = Path(__file__).parents[2] / "config.example.yaml"

HANDED_OVER = "hunter2"

# A # with no space after it takes a key out; prose has a space there.
TAKEN_OUT = re.compile(r"^(\s*)#(?=\S)", re.MULTILINE)


@pytest.fixture
def complete(tmp_path: Path) -> str:
    """The example with every optional line in use, and the files that it names."""
    for name in ("ca.crt", "client.crt", "client.key"):
        (tmp_path / name).touch()
    text = TAKEN_OUT.sub(r"\1", EXAMPLE.read_text(encoding="utf-8"))
    return text.replace("/etc/wisco2mqtt", str(tmp_path))


def _load_complete(folder: Path, text: str) -> Config:
    return load_text(folder, text, WISCO_MQTT_PASSWORD=HANDED_OVER)


def test_the_example_is_valid_as_it_stands() -> None:
    """Copied to config.yaml it passes `check`."""
    config = load_config(EXAMPLE, {})

    assert [line.id for line in config.lines] == ["main", "annex"]


def test_the_example_is_valid_with_all_optional_lines(tmp_path: Path, complete: str) -> None:
    """Taking a # away never breaks the file."""
    config = _load_complete(tmp_path, complete)

    assert config.mqtt.password == HANDED_OVER
    assert config.mqtt.tls is not None
    assert config.mqtt.tls.key == tmp_path / "client.key"
    assert config.homeassistant.configuration_url is not None
    assert config.state_dir == Path("/var/lib/wisco2mqtt")


def test_the_example_shows_every_key(
    tmp_path: Path, complete: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each key that the loader ever asks for stands in the example."""
    asked: set[str] = set()
    original = Table.get

    def recording(self: Table, key: str, *rest: object) -> object:
        asked.add(key)
        return original(self, key, *rest)  # type: ignore[arg-type]  # passed on unchanged

    monkeypatch.setattr(Table, "get", recording)
    _load_complete(tmp_path, complete)

    shown = set(re.findall(r"([a-z_]+):(?=\s)", complete))
    assert len(asked) > 40
    assert asked - shown == set()
