"""The troubles in the house: a random one begins, and something ends it later."""

import heapq
import random
import time
from collections import Counter
from collections.abc import Callable, Iterable

from support.mosquitto import Mosquitto
from support.tcp_relay import TcpRelay

from bridge.simulator.faults import FaultKind
from soak.commander import Commander
from soak.house import (
    HOLD_S,
    LIVE,
    LONGEST_HOLD_S,
    MAX_ON,
    ON_LOSS,
    PULSE,
    READ_ONLY,
    RULES,
    Home,
    House,
    stations_on,
)
from soak.ledger import Ledger
from soak.upkeep import Upkeep

Undo = Callable[[], None]

# What the modules and their cables do, by how often and how long.
LINE_FAULTS = (
    FaultKind.DEAF,
    FaultKind.SILENT,
    FaultKind.REFUSE,
    FaultKind.LATE,
    FaultKind.FLIP,
    FaultKind.FLIP_REQUEST,
    FaultKind.TRUNCATE,
    FaultKind.DUPLICATE,
    FaultKind.MERGE,
    FaultKind.NOISE,
    FaultKind.FLOOD,
)
# A broker that goes down more often than this is not what a house has.
BROKER_EVERY_S = 120.0


class Troubles:
    """Begins and undoes troubles; one thread calls it, every few milliseconds.

    Attributes:
        begun: How often each began.
        history: When each began and ended, for who looks for the cause of a broken promise.
    """

    def __init__(
        self,
        house: House,
        commander: Commander,
        ledger: Ledger,
        broker: Mosquitto,
        relay: TcpRelay,
        upkeep: Upkeep,
        chance: random.Random,
    ) -> None:
        self.begun: Counter[str] = Counter()
        self.history: list[str] = []
        self._house = house
        self._commander = commander
        self._disturbances = ledger.disturbances
        self._link = ledger.link
        self._broker = broker
        self._relay = relay
        self._chance = chance
        self._undo: list[tuple[float, int, Undo]] = []
        self._broker_at = time.monotonic() + BROKER_EVERY_S / 2
        self._kinds: tuple[tuple[int, Callable[[], None]], ...] = (
            (12, self.line_fault),
            (3, self.noise),
            (4, self.away),
            (2, self.hang_up),
            (1, self.echo),
            (1, self.cut),
            (1, self.stall),
            (2, self.burst),
            (2, self.fuzz),
            (2, lambda: upkeep.reload(self.start)),
            (2, lambda: upkeep.suspend(self.start)),
            (3, self.hand),
            (2, self.tool),
        )

    def begin(self) -> None:
        """One trouble begins."""
        if time.monotonic() >= self._broker_at:
            self.restart_broker()
            return
        weights = [weight for weight, _ in self._kinds]
        ((_, kind),) = self._chance.choices(self._kinds, weights)
        kind()

    def undo_due(self, *, everything: bool = False) -> None:
        """Undoes what has lasted long enough."""
        while self._undo and (everything or self._undo[0][0] <= time.monotonic()):
            heapq.heappop(self._undo)[2]()

    # --- on the lines -------------------------------------------------------------------------

    def line_fault(self) -> None:
        """A part of the exchanges, of one module or of a whole line, goes wrong."""
        kind, home = self._chance.choice(LINE_FAULTS), self._home()
        address = home.address if self._chance.random() < 0.7 else None
        probability = self._chance.choice((0.02, 0.1, 0.3, 1.0))
        delay_s = self._chance.uniform(0.05, 0.35) if kind is FaultKind.LATE else None
        faults = self._house.lines[home.line].faults
        faults.set(kind, address=address, probability=probability, delay_s=delay_s)
        struck = [home.id] if address is not None else stations_on(home.line)
        self.start(kind.value, (1, 8), lambda: faults.clear(kind, address=address), struck)

    def noise(self) -> None:
        """Bytes that were not requested."""
        name = self._home().line
        noise = self._chance.randbytes(self._chance.randint(1, 60))
        self._house.lines[name].inject(noise)
        self.start("unasked bytes", (0.5, 0.5), lambda: None, stations_on(name))

    def away(self) -> None:
        """A module loses its supply, and gets it back."""
        home = self._home()
        module = self._house.module(home)
        module.away = True
        self.start("module away", (1, 10), lambda: setattr(module, "away", False), [home.id])

    def hang_up(self) -> None:
        """An adapter is pulled out, and plugged in again."""
        name = self._home().line
        line = self._house.lines[name]
        line.hang_up()
        self.start("port hang-up", (0.2, 5), line.restore, stations_on(name))

    def echo(self) -> None:
        """An adapter that echoes takes the place of one that does not, for a while."""
        name = self._chance.choice(("wis", "rtu"))
        line = self._house.lines[name]

        def exchange_adapter() -> None:
            line.hang_up()
            line.restore()

        def undo() -> None:
            line.faults.clear(FaultKind.ECHO)
            exchange_adapter()

        line.faults.set(FaultKind.ECHO)
        exchange_adapter()
        self.start("echo", (3, 8), undo, stations_on(name))

    # --- on the way to the broker -------------------------------------------------------------

    def restart_broker(self) -> None:
        """The broker goes down, forgets everything, and comes up again."""
        self._broker_at = time.monotonic() + BROKER_EVERY_S
        self._link.broken(time.monotonic())
        self._broker.stop()

        def undo() -> None:
            self._broker.start()
            self._link.mended(time.monotonic())

        self.start("broker restart", (0.1, 8), undo)

    def cut(self) -> None:
        """The bridge's connection is reset."""
        self._link.broken(time.monotonic())
        self._relay.cut()
        self.start("socket cut", (0.1, 0.2), lambda: self._link.mended(time.monotonic()))

    def stall(self) -> None:
        """The network passes nothing on for a while, and closes nothing."""
        self._link.broken(time.monotonic())
        self._relay.stall()

        def undo() -> None:
            self._relay.resume()
            self._link.mended(time.monotonic())

        self.start("link stall", (1, 6), undo)

    # --- what people do -----------------------------------------------------------------------

    def burst(self) -> None:
        """More commands than are let through."""
        self._commander.burst(self._home())
        self.begun["burst of commands"] += 1

    def fuzz(self) -> None:
        """Payloads that mean nothing."""
        self._commander.fuzz(self._home())
        self.begun["fuzzed payloads"] += 1

    def hand(self) -> None:
        """Switch a relay manually at the module."""
        home = self._home()
        outputs = {*home.latches, READ_ONLY, MAX_ON, ON_LOSS}
        outputs |= RULES.motors if home.has_covers else set()
        output = self._chance.choice(sorted(outputs))
        self._house.module(home).set_output(output, self._chance.random() < 0.5)
        self.begun["hand at a relay"] += 1

    def tool(self) -> None:
        """Change modes at the module with a tool, and change them back."""
        home = self._home()
        module = self._house.module(home)
        output = self._chance.choice((PULSE, *home.latches))
        hold_s = self._chance.choice((0.3, LONGEST_HOLD_S))
        module.set_mode(output, pulse=output != PULSE, hold_s=hold_s)

        def undo() -> None:
            module.set_mode(output, pulse=output == PULSE, hold_s=HOLD_S)

        self.start("tool at the modes", (1, 10), undo)

    # --- the inside ---------------------------------------------------------------------------

    def _home(self) -> Home:
        return self._chance.choice(LIVE)

    def start(
        self, name: str, lasts_s: tuple[float, float], undo: Undo, stations: Iterable[str] = ()
    ) -> None:
        """A trouble began; it is undone after a time between two, and `stations` suffer by it."""
        self.begun[name] += 1
        self.history.append(f"{time.monotonic():.3f} {name} {' '.join(stations)}")
        at = time.monotonic() + self._chance.uniform(*lasts_s)
        struck, disturbances = tuple(stations), self._disturbances
        disturbances.begin(struck, time.monotonic())

        def undo_all() -> None:
            undo()
            self.history.append(f"{time.monotonic():.3f} end of {name}")
            disturbances.end(struck, time.monotonic())

        heapq.heappush(self._undo, (at, self.begun.total(), undo_all))
