"""A line worker on the real bus, with simulated modules, faults and the wire in virtual time."""

import random
from collections.abc import Generator, Iterable

from support.commands import make_command
from support.virtual_line import VirtualLine
from support.virtual_worker import VirtualWorker

from bridge.config.schema import LineConfig
from bridge.errors import PortError
from bridge.model import (
    AnyCommand,
    Command,
    LineEvent,
    Verdict,
    Word,
)
from bridge.simulator.conversation import Conversation, HangUp
from bridge.simulator.dialect import Dialect, Tongue
from bridge.simulator.faults import Faults
from bridge.simulator.wire import Pace
from bridge.transport.bus import Bus, bus_of

TURNAROUND_S = 0.002
START_S = 3.0  # by then every station was met

# Yields a command, and is sent its verdict; or yields the seconds that it wants to pass.
Script = Generator[AnyCommand | float, Verdict | None, None]


class BusLine(VirtualLine):
    """A virtual line whose port carries bytes to the simulator's conversation.

    Attributes:
        faults: What goes wrong on the wire.
        conversation: The modules' side of it.
        bus: The bus that was opened last.
        foreign: What somebody else put on the line, and nobody has read yet.
        hung_up: The port is gone, and cannot be opened.
    """

    bus: Bus

    def __init__(
        self,
        config: LineConfig,
        *,
        wisco_only: bool = False,
        seed: int = 1,
        dialects: Iterable[Dialect] = (),
    ) -> None:
        super().__init__(config, wisco_only=wisco_only)
        self.foreign = b""
        self.hung_up = False
        self.faults = Faults(random.Random(seed))  # noqa: S311  # damage, not secrets
        pace = Pace.of(config.protocol, config.baud, TURNAROUND_S, paced=True)
        self.conversation = Conversation(
            config.protocol,
            self.modules,
            pace,
            self.faults,
            tongue=Tongue.of(tuple(dialects)),
        )

    def open(self, config: LineConfig) -> Bus:
        """Opens the port, or raises PortError."""
        super().open(config)
        self.look()
        self.conversation.reset()
        self.bus = bus_of(config, ConversationPort(self), self.clock, self.sleep)
        self.bus.await_silence()
        return self.bus

    def look(self) -> None:
        """Raises PortError where the port is gone."""
        if self.hung_up:
            raise PortError("the port is gone")

    def step(self, until: float) -> None:
        """Lets time pass up to the next thing that happens, or `until`."""
        next_at = self.conversation.next_at()
        said_at = float("inf") if next_at is None else next_at
        self.advance(max(self.now, min(until, said_at, self.next_action_at())))


class ConversationPort:
    """Satisfies `Port`: what the modules say, as the clock of the line comes to it."""

    name = "virtual"

    def __init__(self, line: BusLine) -> None:
        self._line = line
        self._input = b""

    def write(self, data: bytes, deadline: float) -> None:
        """See `Port`."""
        assert self._line.now <= deadline
        self._line.look()
        self._line.wire.append((self._line.now, data))
        self._line.conversation.hear(data, self._line.now)

    def read(self, count: int, deadline: float) -> bytes:
        """See `Port`."""
        self._listen()
        while len(self._input) < count and self._line.now < deadline:
            self._line.step(deadline)
            self._listen()
        data, self._input = self._input[:count], self._input[count:]
        return data

    def discard(self) -> bytes:
        """See `Port`."""
        self._listen()
        data, self._input = self._input, b""
        return data

    def close(self) -> None:
        """See `Port`."""
        self._line.close()

    def _listen(self) -> None:
        self._line.look()
        self._input += self._line.foreign
        self._line.foreign = b""
        for effect in self._line.conversation.advance(self._line.now):
            if isinstance(effect, HangUp):
                raise PortError("the port is gone")
            self._input += effect.data


class BusWorker(VirtualWorker):
    """One line worker on a `BusLine`, run by a script.

    Attributes:
        bus_line: The line.
    """

    def __init__(
        self,
        config: LineConfig,
        *,
        wisco_only: bool = False,
        seed: int = 1,
        dialects: Iterable[Dialect] = (),
    ) -> None:
        self.bus_line = BusLine(config, wisco_only=wisco_only, seed=seed, dialects=dialects)
        self._script: Script | None = None
        super().__init__(config, line=self.bus_line)

    def follow(self, script: Script) -> None:
        """Works until the script ends."""
        self._script = script
        self.line.at(self.line.now + START_S, self._go_on)
        self.worker.work()

    def command(
        self,
        mask: int,
        values: int = 0,
        *,
        station_id: str = "s1",
        word: Word | None = None,
        deadline_s: float = 2.0,
    ) -> Command:
        """A command that arrives now."""
        return make_command(
            mask,
            values,
            word=word,
            station_id=station_id,
            arrived=self.line.now,
            deadline=self.line.now + deadline_s,
        )

    def report(self, event: LineEvent) -> None:
        """See `VirtualWorker`."""
        super().report(event)
        if isinstance(event, Verdict):
            self._go_on(event)

    def _go_on(self, verdict: Verdict | None = None) -> None:
        if self._script is None:
            return
        try:
            wish = self._script.send(verdict)
        except StopIteration:
            self.worker.stop()
            return
        if not isinstance(wish, float | int):
            self.worker.submit(wish)
        else:
            self.line.at(self.line.now + wish, self._go_on)
