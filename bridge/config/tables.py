"""Maps whose keys are declared by reading them, and values that must be unique."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from bridge.config.nodes import D, KeyValue, Place, Reader, T, entries, nearest, shown
from bridge.config.shapes import Shape, either, shape_of


class Table:
    """A map whose keys are declared by reading them. A key that was not read is unknown."""

    def __init__(self, place: Place, found: Mapping[str, KeyValue]) -> None:
        self._place = place
        self._found = found
        self._known: list[str] = []
        self._shapes: dict[str, Shape] = {}
        self._needed: list[str] = []

    def __contains__(self, key: str) -> bool:
        return key in self._found

    def get(self, key: str, reader: Reader[T], default: D) -> T | D:
        """Return the value of an optional key; `default` if it is wrong or left out."""
        self._known.append(key)
        if self._place.source.shapes is not None:
            self._shapes[key] = shape_of(reader, self._place.absent(key))
        return self._found[key].value.read(reader, default) if key in self._found else default

    def need(self, key: str, reader: Reader[T], advice: str) -> T | None:
        """Return the value of a required key; None: it has a problem."""
        self._needed.append(key)
        if key not in self._found:
            self._place.problem(f"{key} is missing; {advice}")
        return self.get(key, reader, None)

    def section(self, key: str, reader: Reader[T]) -> T:
        """Return the value of an optional map; if it is missing or wrong, that of an empty map."""
        read = self.get(key, reader, None)
        if key in self._shapes:  # nothing may stand behind it
            self._shapes[key] = either(self._shapes[key], {"type": "null"})
        return reader(self._place.absent(key)) if read is None else read

    def problem(self, key: str, message: str) -> None:
        """Add a problem at the value of a key, or at the map if the key is left out."""
        self.place(key).problem(message)

    def place(self, key: str) -> Place:
        """Return the place of a value, or of the whole map if the key is left out."""
        return self._found[key].value if key in self._found else self._place

    def close(self) -> None:
        """Add a problem for each key that was not read; note the form where that is asked for."""
        if self._place.source.shapes is not None:
            self._place.source.shapes[self._place.path] = {
                "type": "object",
                "properties": self._shapes,
                "required": self._needed,
                "additionalProperties": False,
            }
        for name, entry in self._found.items():
            if name not in self._known:
                meant = nearest(name, self._known)
                advice = (
                    f"did you mean {meant}?" if meant else f"known are {', '.join(self._known)}"
                )
                entry.key.problem(f"unknown key {shown(name)}; {advice}")


@contextmanager
def table_of(place: Place) -> Iterator[Table]:
    """Open a map for reading; at the end, keys that were not read are problems."""
    table = Table(place, entries(place))
    yield table
    table.close()


class Unique:
    """Remembers where a value was used that must be unique."""

    def __init__(self) -> None:
        self._first: dict[object, Place] = {}

    def claim(self, key: object, place: Place, what: str) -> None:
        """Register `key`; if it is used already, add a problem at `place`."""
        first = self._first.setdefault(key, place)
        if first is not place:
            place.problem(
                f"{what} is taken by {first.path} on line {first.line}; each must be its own"
            )
