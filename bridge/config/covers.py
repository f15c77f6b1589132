"""The covers of a station: each is two outputs that drive one motor, one for each direction."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from bridge.config.device_classes import COVER_DEVICE_CLASSES
from bridge.config.durations import duration
from bridge.config.names import folded, is_id
from bridge.config.nodes import KeyValue, Place, Reader, entries, shown
from bridge.config.scalars import choice, whole
from bridge.config.schema import CoverConfig, OutputConfig
from bridge.config.tables import Table, Unique, table_of
from bridge.config.text import label
from bridge.model import ModuleType, bit

LONGEST_DEAD_TIME_S = 1.0

_DEVICE_CLASSES = {word: word for word in COVER_DEVICE_CLASSES}
_travel_time = duration("1s", "10min")


def covers_of(
    model: ModuleType, outputs: Sequence[OutputConfig], groups: Sequence[int]
) -> Reader[tuple[CoverConfig, ...]]:
    """Return a reader of `covers`; `groups` are those of `interlock`."""
    by_channel = {output.channel: output for output in outputs}

    def read(place: Place) -> tuple[CoverConfig, ...]:
        ids, used = Unique(), Unique()
        found = []
        for name, entry in entries(place).items():
            if _is_cover_id(name, entry, ids):
                cover = entry.value.read(_cover_of(name, model), None)
                if cover is not None:
                    _check_outputs(entry.value, cover, by_channel, groups, used)
                    found.append(cover)
        return tuple(found)

    return read


def with_latches(
    outputs: Sequence[OutputConfig], covers: Sequence[CoverConfig]
) -> tuple[OutputConfig, ...]:
    """Return the outputs, with those of covers declared as latches.

    So a module with another mode is reported as a problem.
    """
    moved = sum(cover.outputs for cover in covers)  # an output is in one cover only
    return tuple(
        replace(output, mode="latch") if moved & bit(output.channel) else output
        for output in outputs
    )


def check_dead_time(table: Table, covers: Sequence[CoverConfig], dead_s: float) -> None:
    """Report a dead time with which a reversal does not fit into the 2 s of a command.

    See docs/contract.md, promise 2.
    """
    if covers and dead_s > LONGEST_DEAD_TIME_S:
        table.problem(
            "interlock_dead_time",
            f"is over {LONGEST_DEAD_TIME_S:g} s, and a cover could not be reversed within the 2 s "
            "that a command is good for; shorten it",
        )


def _is_cover_id(name: str, entry: KeyValue, ids: Unique) -> bool:
    if not is_id(name):
        entry.key.problem(
            f"{shown(name)} cannot be the id of a cover; write a-z and 0-9 joined by single - or _"
        )
        return False
    ids.claim(folded(name), entry.key, f"cover {name}")
    return True


def _cover_of(name: str, model: ModuleType) -> Reader[CoverConfig | None]:
    return lambda place: _read_cover(place, name, model)


def _read_cover(place: Place, name: str, model: ModuleType) -> CoverConfig | None:
    output = whole(1, model.outputs)
    with table_of(place) as table:
        title = table.get("name", label, name)
        opens = table.need("open", output, "write the output that opens it")
        closes = table.need("close", output, "write the output that closes it")
        open_s = table.need("open_time", _travel_time, "write how long the whole way takes, as 20s")
        close_s = table.need(
            "close_time", _travel_time, "write how long the whole way takes, as 20s"
        )
        device_class = table.get("device_class", choice(_DEVICE_CLASSES), None)
        if opens is not None and opens == closes:
            table.problem("close", "is the output of open; each direction takes its own")
            return None
    if opens is None or closes is None or open_s is None or close_s is None:
        return None
    return CoverConfig(name, title, opens, closes, open_s, close_s, device_class)


def _check_outputs(
    place: Place,
    cover: CoverConfig,
    outputs: Mapping[int, OutputConfig],
    groups: Sequence[int],
    used: Unique,
) -> None:
    found = entries(place)
    for key, channel in (("open", cover.open), ("close", cover.close)):
        at = found[key].value
        output = outputs.get(channel)
        if output is None:
            at.problem(f"output {channel} is left out of outputs; write one that is there")
            continue
        used.claim(channel, at, f"output {channel}")
        if any(group & bit(channel) for group in groups):
            at.problem(f"output {channel} is in interlock; a cover interlocks its own two")
        for wrong in _unfit(output):
            at.problem(f"output {channel} has {wrong}, which goes with no cover; take it out there")


def _unfit(output: OutputConfig) -> list[str]:
    options = {
        "mode: pulse": output.mode == "pulse",
        "read_only": output.read_only,
        "as": output.kind != "switch",
        "max_on": output.max_on_s is not None,
        "on_loss": output.on_loss is not None,
    }
    return [name for name, stands in options.items() if stands]
