"""A line whose modules move as many covers as they have outputs for, on a virtual clock."""

from collections.abc import Iterable
from dataclasses import replace

from support.bus_worker import BusWorker
from support.virtual_worker import make_line, make_station

from bridge.config.schema import CoverConfig, LineConfig, OutputConfig, StationConfig
from bridge.model import LineProtocol, ModuleType, bits_of

MET_BY_S = 112.0  # by then a line of a few modules was met, what moves was seen, and all is calm
MOVE_AT_S = 106.0


def moving_station(
    address: int, model: ModuleType, way_s: float = 300.0, most: int = 8
) -> StationConfig:
    """A module with a cover at outputs 1 and 2, at 3 and 4, and so on, `most` at the most."""
    pairs = range(1, min(model.outputs, 2 * most) + 1, 2)
    covers = tuple(CoverConfig(f"c{n}", f"{n}", n, n + 1, way_s, way_s) for n in pairs)
    outputs = tuple(OutputConfig(n, mode="latch") for n in range(1, model.outputs + 1))
    return replace(
        make_station(address, model, outputs=outputs),
        covers=covers,
        interlock=tuple(cover.outputs for cover in covers),
    )


def moving_line(
    stations: Iterable[StationConfig], protocol: LineProtocol, timeout_s: float | None = None
) -> LineConfig:
    """Those on one line."""
    return replace(make_line(*stations, protocol=protocol), timeout_s=timeout_s)


class MovingLine(BusWorker):
    """All covers open since `MOVE_AT_S`: a hand switched them ON.

    Attributes:
        longest_silence_s: The longest time without a sign of life of the worker.
    """

    def __init__(self, config: LineConfig) -> None:
        super().__init__(config)
        self.longest_silence_s = 0.0
        self.line.at(MOVE_AT_S, self._move)

    def away_at(self, instant: float, addresses: Iterable[int], *, away: bool = True) -> None:
        """Has these modules fall silent, or come back."""
        modules = [self.line.modules[address] for address in addresses]

        def switch() -> None:
            for module in modules:
                module.away = away

        self.line.at(instant, switch)

    def watch(self, until: float, every_s: float = 0.25) -> None:
        """Looks for signs of life up to `until`."""

        def look() -> None:
            silence_s = self.line.now - self.worker.progress
            self.longest_silence_s = max(self.longest_silence_s, silence_s)
            if self.line.now + every_s < until:
                self.line.at(self.line.now + every_s, look)

        self.line.at(self.line.now + every_s, look)

    def covers_on(self, addresses: Iterable[int]) -> set[str]:
        """The covers of these whose motor runs, as the log names them."""
        return {
            f"station {config.address} ({config.id}): cover {cover.id} "
            for config in self.config.stations
            if config.address in addresses
            for cover in config.covers
            if self.line.modules[config.address].outputs & cover.outputs
        }

    def off_at(self, address: int) -> float | None:
        """Return when the last motor of a module was switched OFF; None: one runs."""
        module = self.line.modules[address]
        if module.outputs:
            return None
        return max(s.at for s in module.switchings if s.changed and not s.value)

    def _move(self) -> None:
        for config in self.config.stations:
            opening = bits_of(cover.open for cover in config.covers)
            self.line.modules[config.address].write_outputs(opening, opening, b"")
