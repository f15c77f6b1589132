"""A backup of the cabinet by the panel: what `restore` reads, without secrets."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from support.house import make_config
from support.openapi import fits
from support.web_panel import PanelBench, WebAnswer

from bridge.commission.cabinet import Cabinet, read_cabinet
from bridge.commission.image import image_text
from bridge.commission.settings import WantedOutput
from bridge.config.schema import WebConfig
from bridge.model import (
    DIO100,
    CountChanged,
    LineProtocol,
    OutputSettings,
    SettingsRead,
    StationChanged,
)
from bridge.web.config_file import ConfigFile

LOCKED = WebConfig(password="open sesame", token="t-program")  # noqa: S106  # the test's own
KEY = {"Authorization": "Bearer t-program"}
FILE = "web: {}\nmqtt: {password: hunter2}\nlines: []\n"
EEPROM = bytes(range(256)) * 8


@pytest.fixture(name="bench")
def _bench(tmp_path: Path) -> Iterator[PanelBench]:
    """A panel whose modules told their settings; one of them is away."""
    path = tmp_path / "config.yaml"
    path.write_text(FILE)
    with PanelBench(LOCKED, file=ConfigFile(path, {"HOME": str(tmp_path)})) as bench:
        bench.hear(SettingsRead("garage", OutputSettings(0b10, (10, 5, *[10] * 6))))
        bench.panel.hear(CountChanged("garage", 6, 1234))
        bench.hear(StationChanged("main_02", online=False, detail="gone"))
        image = image_text(EEPROM, DIO100)
        bench.answer = {"status": "ok", "data": {"image": image, "final": True}}
        yield bench


def _made(bench: PanelBench) -> dict[str, object]:
    """Make one; return what is told of it at its end."""
    assert bench.ask("POST", "/api/backup", headers=KEY).document == {}
    bench.wait(lambda: not _told(bench)["running"])
    return _told(bench)


def _told(bench: PanelBench) -> dict[str, object]:
    state = fits(bench.ask("GET", "/api/state", headers=KEY), "/api/state", "get")
    return dict(state["state"]["backup"])


def _opened(answer: WebAnswer, folder: Path) -> Cabinet:
    path = folder / "cabinet.zip"
    path.write_bytes(answer.body)
    return read_cabinet(path)


def test_a_backup_is_made_and_downloaded(bench: PanelBench, tmp_path: Path) -> None:
    """Modes, hold times, EEPROM, counts and the configuration; no secret; who is away is named."""
    told = _made(bench)
    assert told["left_out"] == ["main_02: it is offline"]
    assert (told["ready"], told["error"], told["share"]) == (True, None, 1.0)
    assert bench.requests == [("eeprom", {"station": "garage"})]
    answer = bench.ask("GET", "/api/backup", headers=KEY)
    assert answer.headers["content-disposition"].startswith('attachment; filename="wisco2mqtt-')
    cabinet = _opened(answer, tmp_path)
    assert cabinet.config.decode() == FILE.replace("hunter2", "'***'")
    assert cabinet.counts == b'{\n"garage/di/6": 1234\n}\n'
    (garage,) = cabinet.modules
    assert garage.content() == dict(enumerate(EEPROM))
    assert garage.wanted()[1] == WantedOutput(2, pulse=True, hold_ds=5)


def test_a_module_that_cannot_be_read_is_named(bench: PanelBench) -> None:
    """And there is a backup of the others."""
    bench.answer = {"status": "error", "data": {}, "error": "it did not answer"}
    told = _made(bench)
    assert told["left_out"] == ["garage: it did not answer", "main_02: it is offline"]
    assert told["ready"]


def test_settings_that_are_not_known_are_named(bench: PanelBench) -> None:
    """Such as those of a module that was read in Wisco frames alone."""
    bench.hear(SettingsRead("garage", None))
    assert "modes and hold times of garage: they are not known" in str(_made(bench)["left_out"])


def test_one_is_made_at_a_time(bench: PanelBench) -> None:
    """And before the end of the first there is none to download."""
    assert bench.ask("GET", "/api/backup", headers=KEY).status == 409
    bench.answer = {"status": "ok", "data": {"final": False}}
    assert bench.ask("POST", "/api/backup", headers=KEY).status == 200
    assert bench.ask("POST", "/api/backup", headers=KEY).status == 409
    assert bench.ask("GET", "/api/backup", headers=KEY).status == 409


def test_a_file_that_cannot_be_read_makes_no_backup(bench: PanelBench, tmp_path: Path) -> None:
    """It tells why."""
    (tmp_path / "config.yaml").write_text("a: [")
    told = _made(bench)
    assert told["ready"] is False
    assert "config.yaml" in str(told["error"])


def test_without_a_file_there_is_no_backup() -> None:
    """The configuration would be missing in it."""
    with PanelBench() as bench:
        assert bench.ask("POST", "/api/backup").status == 404


def test_on_a_line_of_modbus_rtu_no_eeprom_is_asked_for(tmp_path: Path) -> None:
    """It is out of reach there; the rest is in the backup."""
    path = tmp_path / "config.yaml"
    path.write_text("web: {}\nlines: []\n")
    config = make_config()
    line = replace(config.lines[0], protocol=LineProtocol.MODBUS_RTU)
    file = ConfigFile(path, {"HOME": str(tmp_path)})
    with PanelBench(LOCKED, config=replace(config, lines=(line,)), file=file) as bench:
        bench.hear(SettingsRead("garage", OutputSettings(0, (10,) * 8)))
        _made(bench)
        assert bench.requests == []
        modules = _opened(bench.ask("GET", "/api/backup", headers=KEY), tmp_path).modules
        assert [(one.station_id, one.image) for one in modules] == [
            ("garage", None),
            ("main_02", None),
        ]
