"""Modes and hold times as YAML: what `settings show` prints is what `settings apply` reads.

```yaml
model: DIO100
outputs:
  1: {mode: latch, hold: 1.0s}
  2: {mode: pulse, hold: 0.5s}
```

An output that is left out, and a mode or hold time that is, stays as it is.
"""

from pathlib import Path
from typing import Any

from bridge.commission.settings import WantedOutput, hold_word, mode_word
from bridge.config.compose import compose
from bridge.config.durations import hold_time
from bridge.config.nodes import Place, Reader, Source, entries, shown
from bridge.config.scalars import choice
from bridge.config.tables import table_of
from bridge.errors import ConfigError, Problem
from bridge.files import read_file
from bridge.model import MODULE_TYPES, ModuleType, OutputSettings, bit

_MODES = {"latch": False, "pulse": True}


def format_settings(title: str, model: ModuleType, settings: OutputSettings) -> str:
    """Return all modes and hold times as YAML; `title` becomes a comment."""
    lines = [f"# {title}", f"model: {model.name}", "outputs:"]
    for output, hold_ds in enumerate(settings.hold_ds, 1):
        mode = mode_word(bool(settings.pulse >> (output - 1) & 1))
        lines.append(f"  {output}: {{mode: {mode}, hold: {hold_word(hold_ds)}}}")
    return "\n".join(lines) + "\n"


def settings_document(model: ModuleType, settings: OutputSettings) -> dict[str, Any]:
    """Return the same for JSON; hold times in seconds."""
    outputs = {
        str(output): {"mode": mode_word(bool(settings.pulse & bit(output))), "hold": hold_ds / 10}
        for output, hold_ds in enumerate(settings.hold_ds, 1)
    }
    return {"model": model.name, "outputs": outputs}


def load_settings(path: Path, model: ModuleType) -> tuple[WantedOutput, ...]:
    """Return the settings that a file wants of a module of this model.

    Raises:
        ConfigError: Every problem of the file, each with its place.
    """
    try:
        text = read_file(path).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        problem = Problem(str(path), 1, 1, f"the settings cannot be read: {reason}")
        raise ConfigError([problem]) from None
    return settings_of(text, path, model)


def settings_of(text: str, path: Path, model: ModuleType) -> tuple[WantedOutput, ...]:
    """Return the settings that a text wants of a module of this model; `path`: where it stands.

    Raises:
        ConfigError: Every problem of it, each with its place.
    """
    source = Source(path, {}, [])
    wanted = Place(source, compose(text, str(path)), "").read(_settings(model), None)
    if source.problems or wanted is None:
        raise ConfigError(source.problems)
    return wanted


def _settings(model: ModuleType) -> Reader[tuple[WantedOutput, ...]]:
    def read(place: Place) -> tuple[WantedOutput, ...]:
        with table_of(place) as table:
            written = table.get("model", choice(MODULE_TYPES), model)
            if written != model:
                table.problem(
                    "model", f"these are settings of a {written.name}, and this is a {model.name}"
                )
                table.get("outputs", lambda _: None, None)
                return ()
            return table.need("outputs", _outputs(model), "list at least one output") or ()

    return read


def _outputs(model: ModuleType) -> Reader[tuple[WantedOutput, ...]]:
    known = {str(output): output for output in range(1, model.outputs + 1)}

    def read(place: Place) -> tuple[WantedOutput, ...]:
        wanted = []
        for name, entry in entries(place).items():
            if name not in known:
                entry.key.problem(
                    f"no output {shown(name)} here; a {model.name} has outputs 1 to {model.outputs}"
                )
            else:
                wanted.append(entry.value.read(_output(known[name]), None))
        return tuple(want for want in wanted if want)

    return read


def _output(output: int) -> Reader[WantedOutput]:
    def read(place: Place) -> WantedOutput:
        with table_of(place) as table:
            pulse = table.get("mode", choice(_MODES), None)
            hold_s = table.get("hold", hold_time, None)
        return WantedOutput(output, pulse, None if hold_s is None else round(hold_s * 10))

    return read
