"""Three brokers that act as one: started, killed, frozen and cut off by their own handles."""

import signal
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from support.mosquitto import Mosquitto, free_port
from support.other_brokers import Nats, RabbitMq
from support.tcp_relay import TcpRelay

# docs/fleet.md shows these lines: what a site's mosquitto says of the central one.
JOINED = """\
max_queued_messages 1000000
connection central
address 127.0.0.1:{port}
bridge_protocol_version mqttv50
cleansession true
keepalive_interval 5
restart_timeout 1 5
topic north/+/# out 0
topic north/+/+/do/+/set in 1
topic north/+/+/set in 1
"""


class Node(Protocol):
    """What a cluster needs of one of its brokers."""

    port: int

    def launch(self) -> None:
        """Start it and do not wait."""
        ...

    def kill(self) -> None:
        """Kill it, as a power cut would."""
        ...

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        ...


class Cluster(ABC):
    """Some nodes, by number.

    Attributes:
        nodes: Each is a process of its own.
        quorum: So many have to be there, or nothing can be true.
        protocol: What the bridge speaks with it.
        servers: The nodes that the bridge may use.
        more: What else the bridge has in its section `mqtt`.
        engine: What runs at each node.
    """

    quorum = 2
    protocol = "3.1.1"
    more = ""
    engine = ""

    def __init__(self, nodes: Sequence[Node]) -> None:
        self.nodes = tuple(nodes)
        self.servers = tuple(range(len(nodes)))
        self._away: set[int] = set()
        self._frozen: set[int] = set()
        self._cut: set[int] = set()

    @property
    def taken(self) -> set[int]:
        """Return the nodes that were taken away, and not brought back yet."""
        return self._away | self._frozen | self._cut

    @property
    def live(self) -> list[int]:
        """Return the nodes that run and reach the others."""
        return [number for number in range(len(self.nodes)) if number not in self.taken]

    def start(self) -> None:
        """Start all of them."""
        for node in self.nodes:
            node.launch()

    def kill(self, number: int) -> None:
        """Kill one."""
        self.nodes[number].kill()
        self._away.add(number)

    def freeze(self, number: int) -> None:
        """Stop one where it stands: its connections stay open, and nothing answers."""
        self.nodes[number].signal(signal.SIGSTOP)
        self._frozen.add(number)

    def cut(self, number: int) -> None:
        """Cut one off from the others; clients still reach it."""
        for relay in self.links(number):
            relay.stall()
        self._cut.add(number)

    def restore(self) -> None:
        """Bring back all that is gone."""
        for number in self._cut:
            for relay in self.links(number):
                relay.resume()
        for number in self._frozen:
            self.nodes[number].signal(signal.SIGCONT)
        for number in self._away:
            self.nodes[number].launch()
        self._cut, self._frozen, self._away = set(), set(), set()

    def stop(self) -> None:
        """End all of them."""
        for number in self._frozen:
            self.nodes[number].signal(signal.SIGCONT)
        for node in self.nodes:
            node.kill()

    @abstractmethod
    def links(self, number: int) -> list[TcpRelay]:
        """Return the links between one node and the others."""


def nats_version() -> str:
    """Return what nats-server says of itself."""
    return subprocess.run(
        ["nats-server", "--version"], check=True, capture_output=True, text=True
    ).stdout.strip()


class _NatsNode(Nats):
    """One of the nodes: it reaches the others through relays, and tells none of its address."""

    def __init__(self, directory: Path) -> None:
        super().__init__(directory)
        self.route_port = free_port()
        self.routes: list[int] = []

    def _text(self) -> str:
        routes = ", ".join(f'"nats://127.0.0.1:{port}"' for port in self.routes)
        mqtt = f'mqtt {{ host: "127.0.0.1", port: {self.port}'
        # From 2.10 on two nodes have four links; through relays they may not find all of them.
        pool = "" if " v2.9" in nats_version() else "pool_size: -1, "
        return super()._text().replace(mqtt, f"{mqtt}, stream_replicas: 3") + (
            f'cluster {{ name: "fleet", listen: "127.0.0.1:{self.route_port}", {pool}'
            f'no_advertise: true, routes: [{routes}] }}\nping_interval: "2s"\nping_max: 2\n'
        )


class NatsCluster(Cluster):
    """Three nats-server nodes: JetStream keeps what is retained, three times."""

    more = ", command_qos: 0, repeat: 3s"

    def __init__(self, directory: Path, stack: ExitStack) -> None:
        nodes = [_NatsNode(directory / f"nats{number}") for number in range(3)]
        super().__init__(nodes)
        self.engine = nats_version()
        self._relays: dict[tuple[int, int], TcpRelay] = {}
        for one, node in enumerate(nodes):
            # One of two nodes connects: through relays they do not see that they are linked twice.
            node.routes.append(node.route_port)  # a node without a route is no cluster
            for other in range(one):
                relay = stack.enter_context(TcpRelay(nodes[other].route_port))
                self._relays[one, other] = relay
                node.routes.append(relay.port)

    def links(self, number: int) -> list[TcpRelay]:
        """Return the links between one node and the others."""
        return [relay for pair, relay in self._relays.items() if number in pair]


class _MosquittoNode(Mosquitto):
    """A mosquitto that keeps what is retained on disk, and joins others by its own lines."""

    def __init__(self, directory: Path) -> None:
        super().__init__(directory, persistence=True)
        self.joins: list[str] = []

    def launch(self) -> None:
        """Start it: none of them needs another one."""
        self.start()

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        assert self._process is not None
        self._process.send_signal(number)

    def _configuration(self) -> list[str]:
        few = [line for line in super()._configuration() if line != "log_type all"]
        return [*few, "autosave_interval 1", *self.joins]


class BridgedMosquittos(Cluster):
    """A mosquitto at a site (0), and a central one (1) to which its states go.

    The site's one connects to the central one, states go out and commands come in, so the central
    one never tells the site a state. The bridge uses that of its site alone.
    """

    quorum = 1
    protocol = "5"

    def __init__(self, directory: Path, stack: ExitStack) -> None:
        site, central = (_MosquittoNode(directory / name) for name in ("site", "central"))
        super().__init__((site, central))
        self.servers = (0,)
        self._relay = stack.enter_context(TcpRelay(central.port))
        site.joins = JOINED.format(port=self._relay.port).splitlines()

    @property
    def live(self) -> list[int]:
        """Return those that can be true: without its site the central one cannot."""
        return super().live if 0 in super().live else []

    def links(self, number: int) -> list[TcpRelay]:  # noqa: ARG002  # it is that of both
        """Return the one link that there is."""
        return [self._relay]


class _RabbitNode(RabbitMq):
    """One of the nodes: all have one name server, which it finds or starts, and one cookie."""

    def __init__(self, directory: Path, names_port: int, peers: Sequence[str]) -> None:
        super().__init__(directory)
        self._names_port = names_port
        self._peers = peers

    def _commands(self) -> list[tuple[list[str], Mapping[str, str]]]:
        cookie = self.directory / ".erlang.cookie"
        if not cookie.exists():
            cookie.write_text("FLEET")
            cookie.chmod(0o400)
        server = super()._commands()[-1]
        with (self.directory / "rabbitmq.conf").open("a") as config:
            config.write("cluster_formation.peer_discovery_backend = classic_config\n")
            for number, peer in enumerate(self._peers, 1):
                config.write(f"cluster_formation.classic_config.nodes.{number} = {peer}\n")
            config.write("cluster_partition_handling = pause_minority\n")
        return [server]

    def _environ(self) -> Mapping[str, str]:
        return {**super()._environ(), "RABBITMQ_NODENAME": f"{self.directory.name}@localhost"}


class RabbitCluster(Cluster):
    """Three rabbitmq-server nodes. There is no relay between them: `cut` freezes in its place."""

    def __init__(self, directory: Path, stack: ExitStack) -> None:
        names_port = free_port()
        names = [f"rabbit{number}" for number in range(3)]
        peers = [f"{name}@localhost" for name in names]
        super().__init__([_RabbitNode(directory / name, names_port, peers) for name in names])
        self._names = ["epmd", "-port", f"{names_port}", "-address", "127.0.0.1"]
        self._stack = stack

    def start(self) -> None:
        """Start the name server, and all of them."""
        names = subprocess.Popen(self._names)
        self._stack.callback(names.wait)
        self._stack.callback(names.kill)
        super().start()

    def cut(self, number: int) -> None:
        """Freeze one: a link of Erlang cannot be cut by itself on one machine."""
        self.freeze(number)

    def links(self, number: int) -> list[TcpRelay]:  # noqa: ARG002  # see `cut`
        """Return none."""
        return []
