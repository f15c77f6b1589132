"""What the engine needs of a publisher: `bridge.mqtt` satisfies it."""

from typing import Protocol

from bridge.model import (
    CoverState,
    Gesture,
    LineMeasured,
    OutputSettings,
    StationMeasured,
    Verdict,
)


class Publisher(Protocol):
    """Takes the truth as it changes. Only the hub's thread calls it; nothing here blocks."""

    def line(self, line: str, online: bool) -> None:
        """The port of `line` came or went."""
        ...

    def station(self, station: str, online: bool) -> None:
        """Note that the module is reachable, or is not."""
        ...

    def values(self, station: str, inputs: int, outputs: int) -> None:
        """All channels of the module: only what differs from the last call goes out."""
        ...

    def gesture(self, station: str, channel: int, gesture: Gesture) -> None:
        """Note that an input was pressed so. Told now or never.

        A press that comes late means nothing.
        """
        ...

    def count(self, station: str, channel: int, edges: int) -> None:
        """Tell how often an input went ON, in all."""
        ...

    def settings(self, station: str, settings: OutputSettings | None) -> None:
        """Modes and hold times as read; None: they could not be read."""
        ...

    def cover(self, station: str, cover: str, state: CoverState, position: int | None) -> None:
        """Tell what a cover does, and where it is, 0 closed to 100 open; None: it is not known."""
        ...

    def problem(self, station: str, reason: str | None, detail: str) -> None:
        """Something needs the owner (`reason`), or does not any more (None)."""
        ...

    def line_measured(self, measured: LineMeasured) -> None:
        """Tell how a line did lately."""
        ...

    def station_measured(self, measured: StationMeasured) -> None:
        """Tell how a module did lately."""
        ...

    def verdict(self, verdict: Verdict) -> None:
        """Tell what became of one command. Held while the broker is away."""
        ...
