"""The backup of a cabinet: what its bridge and its modules hold, in one archive.

It is a zip that opens without this program:

    backup.json           when it was made, and of which stations
    config.yaml           as it was, with the secrets that stand in it; of the panel: without
    counts.json           as the bridge keeps them, where it does
    modules/garage.yaml   the modes and hold times of a station, as `settings show` prints them
    modules/garage.hex    its EEPROM, as `eeprom dump` writes it
"""

import io
import json
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bridge.commission.image import parse_image
from bridge.commission.settings import WantedOutput
from bridge.commission.settings_file import settings_of
from bridge.config.names import is_id
from bridge.errors import BridgeError, ConfigError
from bridge.files import MAX_FILE_BYTES, read_file, replace_file
from bridge.model import MODULE_TYPES, ModuleType

_FORM = 1
_MANIFEST, _CONFIG, _COUNTS = "backup.json", "config.yaml", "counts.json"
_MODULES = "modules"
_OWNER_ALONE = 0o600  # a configuration can hold secrets
# The times of the files in it do not count: `made` does, with its zone.
_EPOCH = (1980, 1, 1, 0, 0, 0)
# What zipfile, json and our own readers raise at bytes that no backup has.
_DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, EOFError, RuntimeError),
    *(LookupError, TypeError, ValueError, ConfigError),
)


@dataclass(frozen=True, slots=True)
class KeptModule:
    """What one module held, as texts of the archive.

    Attributes:
        settings: YAML; None: they could not be read.
        image: Intel HEX; None: it was on a line that does not reach the EEPROM.
    """

    station_id: str
    model: ModuleType
    settings: str | None
    image: str | None

    def wanted(self) -> tuple[WantedOutput, ...]:
        """Return its settings, to be compared with those of a module."""
        if self.settings is None:
            return ()
        return settings_of(self.settings, Path(f"{self.station_id}.yaml"), self.model)

    def content(self) -> Mapping[int, int]:
        """Return its EEPROM, to be compared with that of a module."""
        if self.image is None:
            return {}
        found = parse_image(self.image)
        if found.model != self.model:
            raise ValueError(f"{self.station_id}.hex is not of a {self.model.name}")
        return found.content


@dataclass(frozen=True, slots=True)
class Cabinet:
    """What a backup holds.

    Attributes:
        made: When, in ISO 8601.
        version: Of the program that made it.
        counts: The file of counts; None: there was none.
    """

    made: str
    version: str
    config: bytes
    counts: bytes | None
    modules: tuple[KeptModule, ...]


def packed(cabinet: Cabinet) -> bytes:
    """Return the archive."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for name, data in _files_of(cabinet):
            archive.writestr(zipfile.ZipInfo(name, _EPOCH), data, zipfile.ZIP_DEFLATED)
    return made.getvalue()


def write_cabinet(path: Path, cabinet: Cabinet) -> None:
    """Write a backup; if this fails, the file stays as it was.

    Raises:
        BridgeError: It cannot be written there.
    """
    try:
        replace_file(path, packed(cabinet), _OWNER_ALONE)
    except OSError as error:
        raise BridgeError(f"{path} cannot be written: {error.strerror}") from error


def _files_of(cabinet: Cabinet) -> Iterator[tuple[str, bytes]]:
    listed = [{"station": kept.station_id, "model": kept.model.name} for kept in cabinet.modules]
    manifest = {"form": _FORM, "made": cabinet.made, "version": cabinet.version, "modules": listed}
    yield _MANIFEST, json.dumps(manifest, indent=2).encode()
    yield _CONFIG, cabinet.config
    if cabinet.counts is not None:
        yield _COUNTS, cabinet.counts
    for kept in cabinet.modules:
        for ending, text in (("yaml", kept.settings), ("hex", kept.image)):
            if text is not None:
                yield f"{_MODULES}/{kept.station_id}.{ending}", text.encode()


def read_cabinet(path: Path) -> Cabinet:
    """Return what a backup holds.

    Raises:
        BridgeError: It cannot be read, or is no backup, or a later version made it.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(read_file(path))) as archive:
            return _unpacked(archive)
    except OSError as error:
        raise BridgeError(f"{path} cannot be read: {error.strerror}") from error
    except _DAMAGE as error:
        raise BridgeError(f"{path} is no backup of this program, or damaged: {error}") from error


def content_of(path: Path) -> bytes | None:
    """Return the content of a file that a backup holds; None: there is none.

    Raises:
        BridgeError: It cannot be read.
    """
    try:
        return read_file(path)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BridgeError(f"{path} cannot be read: {error.strerror}") from error


def _unpacked(archive: zipfile.ZipFile) -> Cabinet:
    manifest = json.loads(_need(archive, _MANIFEST))
    if manifest["form"] != _FORM:
        raise ValueError(f"its form is {manifest['form']}, and this program reads {_FORM}")
    return Cabinet(
        made=str(manifest["made"]),
        version=str(manifest["version"]),
        config=_need(archive, _CONFIG),
        counts=_get(archive, _COUNTS),
        modules=tuple(_module(listed, archive) for listed in manifest["modules"]),
    )


def _module(listed: Any, archive: zipfile.ZipFile) -> KeptModule:
    station_id, model = listed["station"], MODULE_TYPES[listed["model"]]
    if not is_id(station_id):
        raise ValueError(f"{station_id!r} is no station")
    texts = (_get(archive, f"{_MODULES}/{station_id}.{ending}") for ending in ("yaml", "hex"))
    settings, image = (None if text is None else text.decode() for text in texts)
    kept = KeptModule(station_id, model, settings, image)
    kept.wanted()  # mistakes in them show here, before anything is asked or written
    kept.content()
    return kept


def _need(archive: zipfile.ZipFile, name: str) -> bytes:
    if archive.getinfo(name).file_size > MAX_FILE_BYTES:
        raise ValueError(f"{name} in it is longer than {MAX_FILE_BYTES} bytes")
    return archive.read(name)


def _get(archive: zipfile.ZipFile, name: str) -> bytes | None:
    return _need(archive, name) if name in archive.namelist() else None
