"""Counts how often inputs went ON, continuing from the counts of earlier runs."""

from collections.abc import Mapping

from bridge.config.current import CurrentConfig
from bridge.model import CountChanged, Publish, channels_of

Key = tuple[str, int]  # station id and input


class Counts:
    """The edges of each counted input. Only the main thread uses it.

    The count of earlier runs comes from two places: a file, written now and then (`restore`), and
    the broker, which retains the last published count (`found`). The larger one is used. Nothing is
    published before both are known, so a published count never decreases.

    Attributes:
        changes: The number of changes in this run, so that a file knows what it is missing.
    """

    def __init__(self, current: CurrentConfig, publish: Publish) -> None:
        self.changes = 0
        self._current = current
        self._publish = publish
        self._before: dict[Key, int] = {}  # also of inputs that are no longer counted
        self._since: dict[Key, int] = {}  # edges of this run
        self._settled = False

    @property
    def any(self) -> bool:
        """Return whether anything is counted."""
        return bool(self._current.config.counted)

    def restore(self, kept: Mapping[Key, int]) -> None:
        """Use the counts in a file of an earlier run."""
        self._take(kept)

    def found(self, retained: Mapping[Key, int]) -> None:
        """Use the retained counts at the first connection of this run; then publish all counts."""
        if self._settled:
            return  # by now the broker retains what this run published
        known = self.kept()
        self._take(retained)
        self.changes += self.kept() != known
        self._settled = True
        self.publish_all()

    def rose(self, station_id: str, channels: int) -> None:
        """Count inputs that went ON: bit n-1 is input n."""
        for channel in channels_of(channels):
            key = (station_id, channel)
            self._since[key] = self._since.get(key, 0) + 1
            self.changes += 1
            if self._settled:
                self._tell(key)

    def kept(self) -> dict[Key, int]:
        """Return every count, for a file."""
        return {key: self._count(key) for key in sorted({*self._before, *self._since})}

    def _take(self, known: Mapping[Key, int]) -> None:
        for key, count in known.items():
            self._before[key] = max(count, self._before.get(key, 0))

    def publish_all(self) -> None:
        """Publish every count; one that is counted anew goes on where it once stopped."""
        if self._settled:
            for key in self._current.config.counted:
                self._tell(key)

    def _tell(self, key: Key) -> None:
        self._publish(CountChanged(*key, self._count(key)))

    def _count(self, key: Key) -> int:
        return self._before.get(key, 0) + self._since.get(key, 0)
