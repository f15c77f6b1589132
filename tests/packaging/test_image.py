"""The image: its configuration starts, and its compose file names what is there."""

import shutil
from pathlib import Path

import yaml

from bridge.config.load import load_config
from bridge.config.schema import CURRENT_VERSION

IMAGE = Path(__file__).parents[2] / "packaging" / "image"


def test_its_configuration_has_a_panel_with_a_password_and_no_lines(tmp_path: Path) -> None:
    """The broker is the other container; the password comes from the compose file."""
    services = yaml.safe_load((IMAGE / "compose.yaml").read_text())["services"]
    environ = dict.fromkeys(services["wisco2mqtt"]["environment"], "open sesame")
    path = shutil.copy(IMAGE / "config" / "config.yaml", tmp_path)
    config = load_config(Path(path), {**environ, "HOME": "/"})
    assert config.web is not None
    assert (config.web.host, config.web.port) == ("0.0.0.0", 8099)  # noqa: S104  # of the container
    assert config.web.password == "open sesame"  # noqa: S105  # a stub's
    assert config.mqtt.host in services
    assert (config.lines, config.version) == ((), CURRENT_VERSION)


def test_each_container_is_read_only_and_without_capabilities() -> None:
    """What it mounts of this folder is there."""
    services = yaml.safe_load((IMAGE / "compose.yaml").read_text())["services"]
    for service in services.values():
        assert service["read_only"] is True
        assert service["cap_drop"] == ["ALL"]
        mounted = [one.partition(":")[0] for one in service["volumes"] if one.startswith("./")]
        assert mounted
        assert [one for one in mounted if not (IMAGE / one).exists()] == []
