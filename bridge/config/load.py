"""Finds and loads the configuration: returns a valid one, or reports every problem of it."""

from collections.abc import Mapping
from pathlib import Path

from bridge.config.broker import read_homeassistant, read_mqtt
from bridge.config.compose import compose, place_of
from bridge.config.lines import any_lines, read_lines
from bridge.config.nodes import Place, Source
from bridge.config.rules import rules_of
from bridge.config.schema import OLDEST_VERSION, Config, LineConfig
from bridge.config.shapes import Shape, either, whole_shape
from bridge.config.tables import Table, table_of
from bridge.config.text import file_path, home_folder
from bridge.config.version import version
from bridge.config.web import read_web
from bridge.errors import ConfigError, Problem
from bridge.files import read_file

SEARCHED = (Path("config.yaml"), Path("/etc/wisco2mqtt/config.yaml"))


def find_config(explicit: Path | None) -> Path:
    """Return the file that `-c` named, or the first of the default files that exists.

    Raises:
        ConfigError: No file was named, and no default file exists.
    """
    if explicit is not None:
        return explicit
    for path in SEARCHED:
        if _stands(path):
            return path
    first, second = SEARCHED
    message = f"there is neither this file nor {second}; write one, or name another with -c FILE"
    raise ConfigError([Problem(str(first), 1, 1, message)])


def load_config(path: Path, environ: Mapping[str, str], *, secrets: bool = True) -> Config:
    """Load the configuration at `path`; `environ` is what `!env` and defaults look at.

    `secrets` says whether secrets that stand elsewhere are read: without them no broker can be
    contacted, and all else can be done.

    Raises:
        ConfigError: With every problem, in the order of the file.
    """
    return config_of(read_text(path), path, environ, secrets=secrets)


def config_of(text: str, path: Path, environ: Mapping[str, str], *, secrets: bool = True) -> Config:
    """Return the configuration that `text` is; `path` is the file that it is in, or is meant for.

    Raises:
        ConfigError: As `load_config`.
    """
    node = compose(text, str(path), example="config.example.yaml shows every key")
    source = Source(path, environ, problems=[], secrets=secrets)
    config = Place(source, node, "").read(_read_config, None)
    if config is None or source.problems:
        raise ConfigError(sorted(source.problems, key=lambda found: (found.line, found.column)))
    return config


def config_shape(environ: Mapping[str, str]) -> Shape:
    """Return the form of a configuration, for JSON Schema."""
    source = Source(SEARCHED[0], environ, problems=[], secrets=False, shapes={})
    return _lines_or_web(whole_shape(_read_config, source))


def _lines_or_web(whole: Shape) -> Shape:
    """Return the form in which the lines may be absent or empty where there is `web`."""
    keys = whole["properties"]
    lines = {**keys["lines"], "minItems": 0}
    nothing = {"type": "null"}
    return {
        **whole,
        "properties": {
            **keys,
            "lines": either(lines, nothing),
            "web": either(keys["web"], nothing),
        },
        "required": [],
        "if": {"required": ["web"]},
        "else": {"required": ["lines"], "properties": {"lines": {"type": "array", "minItems": 1}}},
    }


def _read_config(place: Place) -> Config:
    with table_of(place) as table:
        written_for = table.get("config_version", version, OLDEST_VERSION)
        web = table.get("web", read_web, None)
        lines = _read_all_lines(table, has_panel=web is not None)
        return Config(
            mqtt=table.section("mqtt", read_mqtt),
            homeassistant=table.section("homeassistant", read_homeassistant),
            state_dir=_read_state_dir(table, place),
            lines=lines,
            rules=table.get("rules", rules_of(lines), ()),
            web=web,
            version=written_for,
        )


def _read_all_lines(table: Table, *, has_panel: bool) -> tuple[LineConfig, ...]:
    """Read `lines`. With a panel there may be none: it is where they are found."""
    if has_panel:
        return table.get("lines", any_lines, ())
    return table.need("lines", read_lines, "write at least one line") or ()


def _read_state_dir(table: Table, place: Place) -> Path:
    written = table.get("state_dir", file_path, None)
    return written or place.absent("state_dir").read(_default_state_dir, Path())


def _default_state_dir(place: Place) -> Path:
    # systemd gives a list with colons; the unit asks for one folder, so take the first.
    given = place.source.environ.get("STATE_DIRECTORY", "").split(":")[0]
    return Path(given) if given else home_folder(place) / ".local/state/wisco2mqtt"


def read_text(path: Path) -> str:
    """Return the text of a configuration file.

    Raises:
        ConfigError: It cannot be read, or is no text.
    """
    try:
        return read_file(path).decode("utf-8-sig")
    except FileNotFoundError as error:
        message = "there is no such file; write it, or name another with -c FILE"
        raise ConfigError([Problem(str(path), 1, 1, message)]) from error
    except OSError as error:
        message = f"cannot be read ({error.strerror}); check what it is and its permissions"
        raise ConfigError([Problem(str(path), 1, 1, message)]) from error
    except UnicodeDecodeError as error:
        # Not chained: that error holds the whole file, with its secrets.
        line, _ = place_of(error.object.decode("latin-1"), error.start)
        message = f"line {line} is not UTF-8 text; save the file as UTF-8"
        raise ConfigError([Problem(str(path), 1, 1, message)]) from None


def _stands(path: Path) -> bool:
    """Return whether a file exists; also True if that cannot be checked: loading reports why."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError:
        return True
    return True
