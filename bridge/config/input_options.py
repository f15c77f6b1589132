"""The keys `gestures` and `count` of an input."""

from dataclasses import replace

from yaml import MappingNode, ScalarNode

from bridge.config.device_classes import COUNTER_DEVICE_CLASSES
from bridge.config.durations import duration
from bridge.config.nodes import MAP_TAG, Place, Reader, T, WrongValueError, is_empty, is_plain
from bridge.config.scalars import choice, positive_decimal
from bridge.config.schema import CountConfig, GestureConfig
from bridge.config.shapes import Shape, either, looking, shape_of
from bridge.config.tables import Table, table_of
from bridge.config.text import label

MAX_FACTOR = 1_000_000

_DEVICE_CLASSES = {word: word for word in COUNTER_DEVICE_CLASSES}


def _gestures(place: Place) -> GestureConfig:
    default = GestureConfig()
    with table_of(place) as table:
        return GestureConfig(
            long_s=table.get("long", duration("200ms", "60s"), default.long_s),
            double_s=table.get("double", duration("0ms", "10s"), default.double_s),
        )


def _count(place: Place) -> CountConfig:
    with table_of(place) as table:
        read = CountConfig(
            unit=table.get("unit", label, None),
            factor=table.get("factor", positive_decimal(MAX_FACTOR), None),
            device_class=table.get("device_class", choice(_DEVICE_CLASSES), None),
        )
        _check_unit(table, read)
    return read


def _check_unit(table: Table, read: CountConfig) -> None:
    """Report a unit that does not belong to the device class: Home Assistant would refuse it."""
    units = COUNTER_DEVICE_CLASSES.get(read.device_class or "", ())
    is_told = read.unit is None and "unit" in table  # its own problem is already reported
    if units and read.unit not in units and not is_told:
        table.problem(
            "unit" if "unit" in table else "device_class",
            f"device_class {read.device_class} needs a unit of its own; "
            f"write one of {', '.join(units)}",
        )


def _switched(read_map: Reader[T], example: str) -> Reader[T | None]:
    """Return a reader of `true` (all defaults), `false` (None) or a map of options."""

    def read(place: Place) -> T | None:
        node = place.node
        if not isinstance(node, ScalarNode) or is_empty(node):
            return read_map(place)
        if not is_plain(node) or node.value not in {"true", "false"}:
            raise WrongValueError(
                f"{place.shown} is no map of options; write true, false, or one such as {example}"
            )
        empty = MappingNode(MAP_TAG, [], node.start_mark, node.end_mark)
        return read_map(replace(place, node=empty)) if node.value == "true" else None

    def shape(place: Place) -> Shape:
        return either(shape_of(read_map, place), {"type": ["boolean", "null"]})

    return looking(read, shape)


# The readers of `gestures`, the times of the presses, and of `count`, what one edge stands for.
read_gestures = _switched(_gestures, "{long: 1s}")
read_count = _switched(_count, "{unit: kWh, factor: 0.001}")
