"""Kills nodes and links of a cluster by a seeded plan, and measures when all is true again."""

import random
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from soak.ledger import Ledger
from soak.relays import Move
from support.daemon import Daemon

from fleet.clusters import Cluster
from fleet.house import RULES, House, house
from fleet.watchers import Clients, Watcher

PROMISED_S = 15.0  # from the moment at which all nodes are started and all links are whole
GIVE_UP_S = 60.0
START_S = 120.0
COMMANDS_A_SECOND = 10
_STORM = 40
_KINDS = ("node", "frozen", "link", "majority", "all", "storm", "storm", "storm")


@dataclass(frozen=True, slots=True)
class Round:
    """One round: what is done, to which nodes, how long it lasts. One node gone is a minority."""

    kind: str
    nodes: tuple[int, ...]
    lasts_s: float

    @property
    def kills(self) -> int:
        """Return how many nodes or links it takes."""
        return len(self.nodes)


def plan(chance: random.Random, count: int, nodes: int = 3) -> Iterator[Round]:
    """Yield rounds with `count` kills or a few more."""
    while count > 0:
        kind = chance.choice(_KINDS)
        if kind == "storm":
            hit = tuple(chance.randrange(nodes) for _ in range(min(_STORM, count)))
        else:
            amount = {"majority": nodes - 1, "all": nodes}.get(kind, 1)
            hit = tuple(chance.sample(range(nodes), amount))
        made = Round(kind, hit, chance.uniform(0.5, 4.0))
        count -= made.kills
        yield made


@dataclass(slots=True)
class Found:
    """What was measured.

    Attributes:
        without: By kind: seconds until all was true on the nodes that were left.
        again: By kind: seconds from their return until all was true on every node.
        broken: What was not true again within the promised time.
        kills: By kind.
    """

    without: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    again: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    broken: list[str] = field(default_factory=list)
    kills: defaultdict[str, int] = field(default_factory=lambda: defaultdict(int))


class Killing:
    """One cluster, one house, one bridge. One thread.

    Attributes:
        found: How long it took until all was true.
        tally: What relays did, and what was asked for.
        clients: Those at the nodes.
    """

    def __init__(
        self, cluster: Cluster, built: House, clients: Clients, ledger: Ledger, seed: int
    ) -> None:
        self.found = Found()
        self.tally = ledger.tally
        self.clients = clients
        self._cluster = cluster
        self._house = built
        self._ledger = ledger
        self._chance = random.Random(seed)  # noqa: S311  # no secret
        self._topics = built.topics()

    def run(self, count: int, tell: Callable[[str], None]) -> None:
        """Wait until all is true, then take `count` nodes and links away."""
        self._ledger.link.broken(time.monotonic())
        began, wrong = time.monotonic(), self._wrong_at_start()
        if wrong is not None:
            self.found.broken += [f"never true from the start: {wrong}", *self._held()]
            return
        tell(f"all true {time.monotonic() - began:.1f} s after the start of everything")
        self._ledger.link.mended(time.monotonic())
        self._pass(3.0)
        for made in plan(self._chance, count, len(self._cluster.nodes)):
            told = len(self.found.broken)
            self._round(made)
            self.found.kills[made.kind] += made.kills
            self._ledger.judge(self._taken(), time.monotonic())
            tell(f"{sum(self.found.kills.values())} kills: {made.kind}: {self._last(made.kind)}")
            for text in self.found.broken[told:]:
                tell(f"  {text}")
        self._pass(8.0, commands=False)  # the last verdicts, and what a broker still holds back
        self._ledger.judge(self._taken(), time.monotonic(), old_s=0.0)

    def _wrong_at_start(self) -> str | None:
        until = time.monotonic() + START_S
        while wrong := self._true_again(START_S / 4)[1]:
            if time.monotonic() > until:
                return wrong
            self.clients.close()  # those that came too early are not what is measured here
        return None

    def _held(self) -> Iterator[str]:
        for number in self._cluster.live:
            client = Watcher(self._cluster.nodes[number].port, self._topics)
            time.sleep(5.0)
            client.close()
            got = f"{len(client.states)} of {len(self._topics)} topics"
            yield f"a new client at node {number} gets {got}"

    def _last(self, kind: str) -> str:
        without, again = self.found.without[kind], self.found.again[kind]
        return f"{without[-1] if without else 0:.1f} s without, {again[-1]:.1f} s after"

    def _round(self, made: Round) -> None:
        self._ledger.link.broken(time.monotonic())
        if made.kind == "storm":
            for number in made.nodes:
                self._take(made.kind, number)
                self._pass(self._chance.uniform(0.1, 0.5))
                if self._chance.random() < 0.6:
                    self._cluster.restore()
        else:
            for number in made.nodes:
                self._take(made.kind, number)
            self._house.touch(self._chance)
            if len(self._cluster.live) >= self._cluster.quorum and made.lasts_s > 2.0:
                self._measure(made, self.found.without)
            else:
                self._pass(made.lasts_s)
        self._cluster.restore()
        self._house.touch(self._chance)
        self._measure(made, self.found.again)
        self._ledger.link.mended(time.monotonic())
        self._pass(1.0)
        self._pass(0.5, commands=False)  # books are closed while none is on its way

    def _take(self, kind: str, number: int) -> None:
        if number in self._cluster.taken:
            self._cluster.restore()
        if kind == "frozen":
            self._cluster.freeze(number)
        elif kind == "link":
            self._cluster.cut(number)
        else:
            self._cluster.kill(number)

    def _measure(self, made: Round, into: defaultdict[str, list[float]]) -> None:
        took_s, wrong = self._true_again(GIVE_UP_S)
        into[made.kind].append(took_s)
        if wrong is not None or took_s > PROMISED_S:
            what = f"{made.kind} {made.nodes[:6]}: {took_s:.1f} s, {wrong or 'then true'}"
            self.found.broken.append(what)

    def _true_again(self, give_up_s: float) -> tuple[float, str | None]:
        """Return how long it took, and what is still untrue; no command is sent meanwhile."""
        began = time.monotonic()
        while True:
            wrong: str | None = self._untrue()
            took_s = time.monotonic() - began
            if wrong is None or took_s > give_up_s:
                return took_s, wrong
            time.sleep(0.02)

    def _untrue(self) -> str | None:
        live = self._cluster.live
        self.clients.keep_connected(live)
        self.clients.listen()
        for number in live:
            if wrong := self._house.untrue(self.clients.states(number)):
                return f"for a client that stayed at node {number} {wrong}"
        for number in live:
            if wrong := self._untrue_anew(number):
                return f"for a new client at node {number} {wrong}"
        return None

    def _untrue_anew(self, number: int) -> str | None:
        client = Watcher(self._cluster.nodes[number].port, self._topics)
        until = time.monotonic() + 3.0
        try:
            while wrong := self._house.untrue(client.states):
                if time.monotonic() > until:
                    return wrong
                time.sleep(0.01)
        finally:
            client.close()
        return None

    def _pass(self, seconds: float, *, commands: bool = True) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.clients.keep_connected(self._cluster.live)
            if commands:
                self.clients.command()
            self.clients.listen()
            time.sleep(1 / COMMANDS_A_SECOND)

    def _taken(self) -> Iterator[Move]:
        moves = self._house.moves
        while moves:
            yield moves.popleft()


def kill_nodes(
    make: Callable[[Path, ExitStack], Cluster],
    directory: Path,
    count: int,
    seed: int,
    tell: Callable[[str], None],
) -> Killing:
    """Start a cluster and a bridge, and kill `count` nodes and links."""
    with ExitStack() as stack:
        cluster = make(directory, stack)
        if cluster.engine:
            tell(cluster.engine)
        stack.callback(cluster.stop)
        built = stack.enter_context(house())
        servers = ", ".join(f'"127.0.0.1:{cluster.nodes[n].port}"' for n in cluster.servers)
        mqtt = f"servers: [{servers}], protocol: {cluster.protocol}{cluster.more}"
        config = directory / "config.yaml"
        config.write_text(built.configuration(mqtt, f"{directory}"))
        ledger = Ledger(RULES)
        ports = [node.port for node in cluster.nodes]
        clients = Clients(ports, built.topics(), ledger, random.Random(seed))  # noqa: S311
        stack.callback(clients.close)
        cluster.start()
        stack.enter_context(Daemon(config))
        killing = Killing(cluster, built, clients, ledger, seed)
        killing.run(count, tell)
        return killing
