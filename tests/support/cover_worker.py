"""A line worker in virtual time with one cover."""

from dataclasses import replace

from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import CoverConfig, OutputConfig
from bridge.model import (
    CoverChanged,
    CoverCommand,
    CoverState,
    LineProtocol,
    Writes,
)

UP, DOWN = 0b01, 0b10
OPEN_S, CLOSE_S = 20.0, 10.0
DEAD_S = 0.5
OPEN, CLOSE, STOP = 100, 0, None


class CoverWorker(VirtualWorker):
    """A line with one station `s1`, whose outputs 1 and 2 open and close `shutter`."""

    def __init__(
        self, protocol: LineProtocol = LineProtocol.WISCO, writes: Writes = Writes.AUTO
    ) -> None:
        outputs = (
            *(OutputConfig(n, mode="latch") for n in (1, 2)),
            *map(OutputConfig, range(3, 9)),
        )
        config = replace(
            make_station(outputs=outputs),
            covers=(CoverConfig("shutter", "Shutter", 1, 2, OPEN_S, CLOSE_S),),
            interlock=(UP | DOWN,),
            interlock_dead_s=DEAD_S,
        )
        super().__init__(make_line(config, protocol=protocol, writes=writes))
        self.module = self.line.modules[1]

    def ask(
        self, at: float, goal: int | None, command_id: str | None = None, deadline_s: float = 2.0
    ) -> None:
        """Has a command to the cover arrive at that instant."""
        command = CoverCommand(
            "s1",
            "cover/shutter",
            str(goal),
            "shutter",
            UP | DOWN,
            goal,
            arrived=at,
            deadline=at + deadline_s,
            id=command_id,
        )
        self.line.at(at, lambda: self.worker.submit(command))

    def orders(self) -> list[tuple[float, int, bool]]:
        """What frames ordered of the cover's outputs: when, which, what."""
        return [(s.at, s.output, s.value) for s in self.module.switchings if s.frame]

    def moves(self) -> list[tuple[int, bool]]:
        """The same without the instants."""
        return [(output, value) for _, output, value in self.orders()]

    def shown(self, since: float = 0.0) -> list[tuple[CoverState, int | None]]:
        """What was told of the cover."""
        return [
            (event.state, event.position)
            for event in self.reported(since)
            if isinstance(event, CoverChanged)
        ]

    def states(self, since: float = 0.0) -> list[CoverState]:
        """The states that it went through."""
        states = [state for state, _ in self.shown(since)]
        return [s for n, s in enumerate(states) if n == 0 or s is not states[n - 1]]

    def check(self) -> None:
        """Never two ON at once, with the dead time between one and the other."""
        outputs, off_at = 0, {UP: 0.0, DOWN: 0.0}
        for switching in self.module.switchings:
            bit = 1 << (switching.output - 1)
            if bit not in off_at:
                continue
            if switching.value:
                other = DOWN if bit == UP else UP
                assert not outputs & other, "both directions ON"
                assert switching.at - off_at[other] >= self.config.stations[0].interlock_dead_s
                outputs |= bit
            elif outputs & bit:
                outputs &= ~bit
                off_at[bit] = switching.at
