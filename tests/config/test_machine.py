"""The name of the machine in the default client id."""

from pathlib import Path

import pytest

from bridge.config.machine import machine_name

MACHINE_ID = "0123456789abcdef0123456789abcdef"


def test_a_machine_is_named_by_its_id_and_does_not_give_it_away(tmp_path: Path) -> None:
    """8 hex digits, always the same, and not those of the id."""
    path = tmp_path / "machine-id"
    path.write_text(MACHINE_ID + "\n")

    name = machine_name(path, "pi")

    assert name == machine_name(path, "another host name")
    assert len(name) == 8
    assert int(name, 16) >= 0
    assert name not in MACHINE_ID


@pytest.mark.parametrize("content", [None, "", "uninitialized\n"])
@pytest.mark.parametrize(
    ("hostname", "name"), [("Wisco-Pi.local", "wisco-pi-local"), ("เครื่อง", "host"), ("", "host")]
)
def test_without_a_machine_id_the_host_name_stands_in(
    tmp_path: Path, content: str | None, hostname: str, name: str
) -> None:
    """Containers and first boots have none; a topic-safe form of the host name is used."""
    path = tmp_path / "machine-id"
    if content is not None:
        path.write_text(content)

    assert machine_name(path, hostname) == name
