"""The inputs and outputs of a station: every channel of the model, also those not in the file."""

from collections.abc import Callable, Mapping

from yaml import ScalarNode

from bridge.config.device_classes import BINARY_SENSOR_DEVICE_CLASSES
from bridge.config.durations import duration, hold_time
from bridge.config.fail_safe import check_fail_safe, max_on, read_on_loss
from bridge.config.input_options import read_count, read_gestures
from bridge.config.nodes import (
    KeyValue,
    Place,
    Reader,
    T,
    WrongValueError,
    entries,
    is_empty,
    is_plain,
    scalar,
    shown,
)
from bridge.config.scalars import boolean, choice
from bridge.config.schema import InputConfig, OutputConfig
from bridge.config.tables import table_of
from bridge.config.text import label
from bridge.model import ModuleType

_DEVICE_CLASSES = {word: word for word in BINARY_SENSOR_DEVICE_CLASSES}
_KINDS = {word: word for word in ("light", "valve", "siren", "fan", "lock", "switch")}
_MODES = {word: word for word in ("latch", "pulse")}


def inputs_of(model: ModuleType) -> Reader[tuple[InputConfig, ...]]:
    """Return a reader of `inputs`."""
    return _channels(model, "inputs", model.inputs, _read_input)


def outputs_of(model: ModuleType) -> Reader[tuple[OutputConfig, ...]]:
    """Return a reader of `outputs`."""
    return _channels(model, "outputs", model.outputs, _read_output)


def _read_input(place: Place, channel: int) -> InputConfig:
    with table_of(place) as table:
        return InputConfig(
            channel,
            name=table.get("name", label, None),
            device_class=table.get("device_class", choice(_DEVICE_CLASSES), None),
            invert=table.get("invert", boolean, False),
            debounce_s=table.get("debounce", duration("0ms", "60s"), 0.0),
            gestures=table.get("gestures", read_gestures, None),
            count=table.get("count", read_count, None),
        )


def _read_output(place: Place, channel: int) -> OutputConfig:
    with table_of(place) as table:
        output = OutputConfig(
            channel,
            name=table.get("name", label, None),
            kind=table.get("as", choice(_KINDS), "switch"),
            mode=table.get("mode", choice(_MODES), None),
            hold_s=table.get("hold", hold_time, None),
            read_only=table.get("read_only", boolean, False),
            max_on_s=table.get("max_on", max_on, None),
            on_loss=table.get("on_loss", read_on_loss, None),
        )
        if output.mode == "pulse" and output.kind != "switch":
            # docs/home-assistant.md: a pulse output is a button.
            table.problem("as", "cannot stand beside mode: pulse; take one of the two out")
        if output.mode != "pulse" and "hold" in table:
            table.problem("hold", "goes only with mode: pulse; write that too, or take hold out")
        check_fail_safe(table, output)
    return output


def _channels(
    model: ModuleType, kind: str, count: int, read_one: Callable[[Place, int], T]
) -> Reader[tuple[T, ...]]:
    known = {str(channel): channel for channel in range(1, count + 1)}
    has = f"{kind} 1 to {count}, written in plain decimal" if count else f"no {kind}"

    def read(place: Place) -> tuple[T, ...]:
        found = entries(place)
        for name, entry in found.items():
            if name not in known:
                entry.key.problem(f"no channel {shown(name)} here; a {model.name} has {has}")
        channels = (_read_channel(place, found, channel, read_one) for channel in known.values())
        return tuple(channel for channel in channels if channel is not None)

    return read


def _read_channel(
    place: Place, found: Mapping[str, KeyValue], channel: int, read_one: Callable[[Place, int], T]
) -> T | None:
    """Read one channel; None if `false` leaves it out."""
    entry = found.get(str(channel))
    if entry is None:
        return read_one(place.absent(str(channel)), channel)
    here = entry.value
    if isinstance(here.node, ScalarNode) and not is_empty(here.node):
        return here.read(_left_out, None)
    return here.read(lambda place: read_one(place, channel), None)


def _left_out(place: Place) -> None:
    node = scalar(place)
    if not is_plain(node) or node.value != "false":
        raise WrongValueError(
            f"{place.shown} is no map of options; "
            "write one, such as {name: Door}, or false to leave the channel out"
        )
