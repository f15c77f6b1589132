"""The form of a configuration as JSON Schema, from the very readers that read it.

A reader of one value carries its own form (`shaped`). A reader of a map or a list has none: it is
run over an empty place that writes down which keys it asks for, and by which readers. So there is
no second list of keys.
"""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from yaml import MappingNode
from yaml.error import Mark

from bridge.config.nodes import MAP_TAG, Place, Reader, Source, T

R = TypeVar("R", bound=Callable[..., Any])
Shape = Mapping[str, Any]
_ATTRIBUTE = "shape"


def shaped(reader: R, shape: Shape) -> R:
    """Give a reader its form."""
    setattr(reader, _ATTRIBUTE, shape)
    return reader


def whole_shape(reader: Reader[Any], source: Source) -> Shape:
    """Return the form of a whole file that `reader` reads."""
    start = Mark(str(source.path), 0, 0, 0, None, 0)
    return shape_of(reader, Place(source, MappingNode(MAP_TAG, [], start, start), ""))


def shape_of(reader: Reader[Any], place: Place) -> Shape:
    """Return the form of what a reader takes; `place` is an empty one where it may look around."""
    own: Shape | None = getattr(reader, _ATTRIBUTE, None)
    if own is not None:
        return own
    if place.source.shapes is None:
        return {}
    place.read(reader, None)
    found: Shape = place.source.shapes.get(place.path, {})
    item: Shape | None = place.source.shapes.get(f"{place.path}[0]")
    return found if item is None else {"type": "array", "items": item, "minItems": 1}


def looking(reader: Reader[T], shape_at: Callable[[Place], Shape]) -> Reader[T]:
    """Return a reader that also notes its form, which is not that of the map that it reads."""

    def read(place: Place) -> T:
        value = reader(place)
        if place.source.shapes is not None:
            place.source.shapes[place.path] = shape_at(place)
        return value

    return read


def either(*shapes: Shape) -> Shape:
    """Return the form of what has one of several."""
    return {"anyOf": list(shapes)}


def words(*options: str) -> Shape:
    """Return the form of a closed word. Also a word that stands elsewhere (`!env`) is one."""
    return {"enum": list(options)}


def named(pattern: str, shape: Shape) -> Shape:
    """Return the form of a map whose keys are names."""
    return {"type": "object", "patternProperties": {pattern: shape}, "additionalProperties": False}
