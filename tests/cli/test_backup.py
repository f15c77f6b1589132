"""`wisco2mqtt backup` and `restore`: there and back; what is written is what differs."""

import json
import stat
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.commission_line import STATION, Laptop, config_of, line_of_one
from support.laptop import Ended

from bridge.cli import main as cli
from bridge.cli.frame.locks import SCOPE_VARIABLE, BaseTopicLocks
from bridge.config.without_secrets import without_secrets
from bridge.model import LineProtocol, OutputSettings
from bridge.simulator import FaultKind, SimulatedModule

_LOGIN = "host: localhost, username: wisco, password: "
COUNTS = '{"garage/di/5": 1234}\n'


@dataclass(frozen=True)
class Cabinet:
    """A configuration, a file of counts, and a module on a line."""

    laptop: Laptop
    config: Path
    counts: Path
    backup: Path

    @property
    def module(self) -> SimulatedModule:
        """The one that is on the line."""
        return self.laptop.line.module(STATION)

    def run(self, *words: str) -> Ended:
        """Runs a command with this configuration."""
        return self.laptop.run("-c", str(self.config), *words)

    def save(self) -> Ended:
        """Makes the backup."""
        return self.run("backup", str(self.backup), "--force")

    def restore(self, *words: str) -> Ended:
        """Brings it back."""
        return self.run("restore", str(self.backup), *words)


@pytest.fixture(params=list(LineProtocol))
def cabinet(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Cabinet]:
    """On a line of each protocol."""
    monkeypatch.setattr(cli, "configure_logging", lambda *_: None)
    monkeypatch.setenv(SCOPE_VARIABLE, str(tmp_path))
    with line_of_one(request.param) as line:
        counts = tmp_path / "counts-wisco.json"
        counts.write_text(COUNTS)
        config = config_of(tmp_path, line)
        made = Cabinet(Laptop(capsys, line, config), config, counts, tmp_path / "cabinet.zip")
        made.module.set_mode(2, pulse=False, hold_s=2.0)
        done = made.save()
        assert (done.status, done.out) == (0, ""), done
        yield made


wisco = pytest.mark.parametrize("cabinet", [LineProtocol.WISCO], indirect=True)


def test_a_backup_opens_without_this_program(cabinet: Cabinet) -> None:
    """A zip with the configuration, the counts, and modes, hold times and EEPROM as files."""
    with zipfile.ZipFile(cabinet.backup) as archive:
        files = {name: archive.read(name).decode() for name in archive.namelist()}
    assert files["config.yaml"] == cabinet.config.read_text()
    assert files["counts.json"] == COUNTS
    assert json.loads(files["backup.json"])["modules"] == [{"station": "garage", "model": "DIO100"}]
    assert "1: {mode: latch, hold: 1.0s}" in files["modules/garage.yaml"]
    reached = cabinet.laptop.line.protocol is not LineProtocol.MODBUS_RTU
    assert ("modules/garage.hex" in files) is reached


def test_a_backup_is_for_its_owner_alone_and_writes_to_no_module(cabinet: Cabinet) -> None:
    """Passwords can stand in a configuration."""
    assert stat.S_IMODE(cabinet.backup.stat().st_mode) == 0o600
    assert cabinet.module.eeprom_writes == 0
    assert not cabinet.module.ordered


def test_a_file_that_is_there_stays(cabinet: Cabinet) -> None:
    """An older backup may be the last good one."""
    done = cabinet.run("backup", str(cabinet.backup))
    assert (done.status, "is there already" in done.complaint) == (1, True)


def test_nothing_differs_right_after_it(cabinet: Cabinet) -> None:
    """And nothing is asked or written."""
    done = cabinet.restore()
    assert (done.status, done.out) == (0, "")
    assert "nothing differs" in done.err
    assert cabinet.module.eeprom_writes == 0


def test_everything_comes_back(cabinet: Cabinet) -> None:
    """Configuration, counts, modes and hold times: shown, written, and then nothing differs."""
    before = cabinet.config.read_text()
    cabinet.config.write_text(before.replace("id: garage", "id: garage, area: Yard"))
    cabinet.counts.write_text('{"garage/di/5": 7}\n')
    cabinet.module.set_mode(2, pulse=True, hold_s=0.5)
    done = cabinet.restore("--yes")
    assert done.status == 0, done
    assert "garage do/2 mode: pulse -> latch\ngarage do/2 hold: 0.5s -> 2.0s\n" in done.out
    assert '  +{"garage/di/5": 1234}\n' in done.out
    assert cabinet.config.read_text() == before
    assert cabinet.counts.read_text() == COUNTS
    assert cabinet.module.settings == OutputSettings(0, (10, 20, *[10] * 6))
    # Two registers; and where the EEPROM is reached, the bits of the mode that no output uses.
    reached = cabinet.laptop.line.protocol is not LineProtocol.MODBUS_RTU
    assert cabinet.module.eeprom_writes == 2 + reached
    assert "area: Yard" in cabinet.config.with_name("config.yaml.before").read_text()
    assert "nothing differs" in cabinet.restore().err


@wisco
def test_only_bytes_of_the_eeprom_that_differ_are_written(cabinet: Cabinet) -> None:
    """An EEPROM wears out."""
    cabinet.module.write_eeprom(0x300, b"\x01\x02")
    writes = cabinet.module.eeprom_writes
    done = cabinet.restore("--yes")
    assert done.status == 0, done
    assert done.out == "garage: 2 bytes of the EEPROM differ\n"
    assert cabinet.module.read_eeprom(0x300, 2) != b"\x01\x02"
    assert cabinet.module.eeprom_writes == writes + 1


@wisco
def test_a_named_station_is_all_that_is_restored(cabinet: Cabinet) -> None:
    """Such as a module that was replaced; the configuration is not looked at."""
    cabinet.counts.write_text('{"garage/di/5": 7}\n')
    cabinet.module.set_mode(1, pulse=True)
    assert cabinet.restore("garage", "--yes").status == 0
    assert cabinet.module.settings.pulse == 0
    assert cabinet.counts.read_text() == '{"garage/di/5": 7}\n'
    done = cabinet.restore("garden")
    assert done.status == 2
    assert "there is no station garden in" in done.err


@wisco
def test_nothing_is_written_unasked(cabinet: Cabinet) -> None:
    """Without a terminal to ask at it needs --yes."""
    cabinet.module.set_mode(1, pulse=True)
    cabinet.config.write_text(cabinet.config.read_text() + "# mine\n")
    done = cabinet.restore()
    assert (done.status, "add --yes" in done.err) == (2, True)
    assert cabinet.module.eeprom_writes == 0
    assert cabinet.config.read_text().endswith("# mine\n")


@wisco
def test_a_machine_without_a_configuration_gets_it(cabinet: Cabinet, tmp_path: Path) -> None:
    """The modules are found as the backup says."""
    wanted = cabinet.config.read_text()
    cabinet.config.unlink()
    cabinet.module.set_mode(1, pulse=True)
    assert cabinet.restore("--yes").status == 0
    assert cabinet.config.read_text() == wanted
    assert cabinet.module.settings.pulse == 0
    assert not (tmp_path / "config.yaml.before").exists()


@wisco
def test_secrets_are_not_shown(cabinet: Cabinet) -> None:
    """What differs in them is only told."""
    text = cabinet.config.read_text()
    cabinet.config.write_text(text.replace("host: localhost", f"{_LOGIN}old"))
    assert cabinet.save().status == 0
    cabinet.config.write_text(text.replace("host: localhost", f"{_LOGIN}new"))
    done = cabinet.restore("--yes")
    assert done.out == f"{cabinet.config} differs:\n  (a secret)\n"
    assert "password: old" in cabinet.config.read_text()


@wisco
def test_secrets_that_a_backup_hides_stay_as_they_are(cabinet: Cabinet) -> None:
    """The panel writes none into a backup; where there is none now, the problem is told."""
    text = cabinet.config.read_text().replace("host: localhost", f"{_LOGIN}kept")
    cabinet.config.write_text(text)
    assert cabinet.save().status == 0
    _hide(cabinet.backup, text)
    assert "nothing differs" in cabinet.restore().err
    cabinet.config.write_text(f"# mine\n{text}")
    assert cabinet.restore("--yes").status == 0
    assert cabinet.config.read_text() == text
    cabinet.config.unlink()
    done = cabinet.restore("--yes")
    assert (done.status, "hides no secret here; write it" in done.err) == (78, True), done
    assert not cabinet.config.exists()


@wisco
def test_while_the_bridge_runs_nothing_is_restored(cabinet: Cabinet) -> None:
    """It would write its own counts at its end."""
    with BaseTopicLocks() as locks:
        locks.acquire("wisco")
        done = cabinet.restore("--yes")
    assert (done.status, "systemctl stop wisco2mqtt" in done.err) == (1, True)


@wisco
def test_no_answer_leaves_no_backup(cabinet: Cabinet) -> None:
    """A backup of nothing would be taken for one."""
    cabinet.laptop.line.faults.set(FaultKind.DEAF)
    cabinet.backup.unlink()
    done = cabinet.run("backup", str(cabinet.backup))
    assert (done.status, "does not answer" in done.complaint) == (1, True)
    assert not cabinet.backup.exists()


@pytest.mark.parametrize("damage", ["cut", "text", "form", "station", "hex", "yaml"])
@wisco
def test_a_damaged_backup_is_one_line(cabinet: Cabinet, damage: str) -> None:
    """Nothing of it is used."""
    whole = cabinet.backup.read_bytes()
    if damage in {"cut", "text"}:
        cabinet.backup.write_bytes(whole[: len(whole) // 2] if damage == "cut" else b"no zip")
    else:
        _damage(cabinet.backup, damage)
    done = cabinet.restore("--yes")
    assert (done.status, str(cabinet.backup) in done.complaint) == (1, True), done


def _hide(path: Path, text: str) -> None:
    """Write the archive anew as the panel does."""
    _change(path, "config.yaml", text, without_secrets(text, "config.yaml"))


def _damage(path: Path, what: str) -> None:
    """Write the archive anew with one file of it changed."""
    change = {
        "form": ("backup.json", '"form": 1', '"form": 2'),
        "station": ("backup.json", "garage", "../garage"),
        "hex": ("modules/garage.hex", ":10", ":1G"),
        "yaml": ("modules/garage.yaml", "latch", "lash"),
    }
    _change(path, *change[what])


def _change(path: Path, name: str, old: str, new: str) -> None:
    with zipfile.ZipFile(path) as archive:
        files = {each: archive.read(each).decode() for each in archive.namelist()}
    assert old in files[name]
    with zipfile.ZipFile(path, "w") as archive:
        for each, text in files.items():
            archive.writestr(each, text.replace(old, new, 1) if each == name else text)
