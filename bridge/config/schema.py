"""The configuration as frozen values, with its defaults (docs/configuration.md).

Times are in seconds. This file neither reads YAML nor checks anything: `bridge.config.load` does.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path

from bridge.model import LineProtocol, ModuleType, Writes, bit, bits_of

# `turnaround: auto` and `late_window: auto` come to no more than this.
LONGEST_LEARNED_S = 1.25

USUAL_RATE_LIMIT = 20.0  # commands a second

# Of `config_version`: of a file that names none, and of one that this release writes.
OLDEST_VERSION = 1
CURRENT_VERSION = 2


@dataclass(frozen=True, slots=True)
class TlsConfig:
    """TLS to the broker; verification is always on. None: the certificates of the system."""

    ca: Path | None = None
    cert: Path | None = None
    key: Path | None = None


@dataclass(frozen=True, slots=True)
class Server:
    """Where a broker, or one of its nodes, is."""

    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{host}:{self.port}"


@dataclass(frozen=True, slots=True)
class MqttConfig:
    """The broker, and who we are there.

    Attributes:
        others: The servers of the same cluster besides `host` and `port`, to be tried in turn.
        command_qos: The highest QoS of all subscriptions: 1, or 0.
        repeat_s: All states are published again this often; None: only when there is a cause.
    """

    host: str
    port: int
    base_topic: str
    client_id: str
    protocol: str  # "auto" | "5" | "3.1.1"
    username: str | None = None
    password: str | None = field(default=None, repr=False)
    tls: TlsConfig | None = None
    others: tuple[Server, ...] = ()
    command_qos: int = 1
    repeat_s: float | None = None

    @property
    def servers(self) -> tuple[Server, ...]:
        """Return all servers, in their order."""
        return (Server(self.host, self.port), *self.others)

    def at(self, server: Server) -> "MqttConfig":
        """Return the same for one server alone."""
        return replace(self, host=server.host, port=server.port, others=())


@dataclass(frozen=True, slots=True)
class HomeAssistantConfig:
    """The announcement of devices to Home Assistant."""

    discovery: str  # "device" | "single" | "off"
    prefix: str
    status_topic: str
    configuration_url: str | None = None
    language: str = "en"  # of words that are added to names: "en" | "th" | "de"


@dataclass(frozen=True, slots=True)
class WebConfig:
    """The panel in the browser: where it listens, and the keys to it."""

    host: str = "127.0.0.1"
    port: int = 8099
    password: str | None = field(default=None, repr=False)
    token: str | None = field(default=None, repr=False)  # for programs that switch
    read_token: str | None = field(default=None, repr=False)  # for those that only look
    read_only: bool = False
    proxy: str | None = None  # the address of a proxy in front of it, whose names are its own


@dataclass(frozen=True, slots=True)
class GestureConfig:
    """The times that tell the presses of a button apart."""

    long_s: float = 0.8  # a press of at least this length is a long one
    double_s: float = 0.4  # at most between the two presses of a double one; 0: no double presses


@dataclass(frozen=True, slots=True)
class CountConfig:
    """The value of one edge of a counted input: `factor` of a `unit`."""

    unit: str | None = None
    factor: Decimal | None = None
    device_class: str | None = None  # one of Home Assistant's for sensors


@dataclass(frozen=True, slots=True)
class InputConfig:
    """One discrete input, whether the file names it or not."""

    channel: int
    name: str | None = None
    device_class: str | None = None
    invert: bool = False
    debounce_s: float = 0.0
    gestures: GestureConfig | None = None  # None: it is no button
    count: CountConfig | None = None  # None: its edges are not counted


@dataclass(frozen=True, slots=True)
class OnLossConfig:
    """The state that an output takes when the broker was away for `after_s`."""

    after_s: float
    on: bool


@dataclass(frozen=True, slots=True)
class OutputConfig:
    """One output, whether the file names it or not.

    `mode` and `hold_s` declare what the module has.
    """

    channel: int
    name: str | None = None
    kind: str = "switch"  # `as:` in the file: a Home Assistant platform
    mode: str | None = None  # "latch" | "pulse" | None: not declared
    hold_s: float | None = None
    read_only: bool = False
    max_on_s: float | None = None  # it is switched OFF after it was seen ON for this time
    on_loss: OnLossConfig | None = None


@dataclass(frozen=True, slots=True)
class CoverConfig:
    """Two outputs that drive one motor. The times are those of the whole way."""

    id: str
    name: str
    open: int  # the output of each direction
    close: int
    open_s: float
    close_s: float
    device_class: str | None = None

    @property
    def outputs(self) -> int:
        """Return its outputs as bits."""
        return bit(self.open) | bit(self.close)


@dataclass(frozen=True, slots=True)
class StationConfig:
    """One module. `inputs` and `outputs` hold every channel that is not left out."""

    address: int
    model: ModuleType
    id: str
    name: str
    inputs: tuple[InputConfig, ...]
    outputs: tuple[OutputConfig, ...]
    area: str | None = None
    high_priority: bool = False
    rate_limit: float = USUAL_RATE_LIMIT
    interlock: tuple[int, ...] = ()  # groups, bit n-1 for output n: never two of one ON
    interlock_dead_s: float = 0.5
    covers: tuple[CoverConfig, ...] = ()  # each is a group of `interlock` too

    @property
    def read_only_outputs(self) -> int:
        """Return the outputs that no command may switch: bit n-1 is output n."""
        return bits_of(output.channel for output in self.outputs if output.read_only)

    @property
    def cover_outputs(self) -> int:
        """Return the outputs that belong to covers: bit n-1 is output n."""
        return sum(cover.outputs for cover in self.covers)


@dataclass(frozen=True, slots=True)
class LineConfig:
    """One RS485 line and its modules. None: the value is computed from baud rate and length.

    Attributes:
        turnaround_auto: `turnaround_s` is only the first value: it is learned for each module.
        late_window_auto: The same for `late_window_s`.
    """

    id: str
    port: str
    baud: int
    protocol: LineProtocol
    stations: tuple[StationConfig, ...]
    writes: Writes = Writes.AUTO
    turnaround_s: float = 0.005
    timeout_s: float | None = None
    silence_s: float | None = None
    late_window_s: float = 0.3
    turnaround_auto: bool = False
    late_window_auto: bool = False
    output_sweep_s: float = 2.0  # 0: outputs are read as often as inputs

    def asks_modbus(self, config: StationConfig) -> bool:
        """Return whether a station may be asked in Modbus frames.

        Station 0 is never asked: it is the broadcast address of Modbus (docs/protocol.md section
        1).
        """
        if self.protocol is not LineProtocol.WISCO:
            return True
        return self.writes is not Writes.WISCO and config.address != 0


@dataclass(frozen=True, slots=True)
class RuleOrder:
    """What a rule orders: one output or one cover.

    Attributes:
        target: `do/2` or `cover/shutter`.
        word: ON, OFF, TOGGLE, PRESS; for a cover OPEN, CLOSE, STOP.
        mask: The outputs that it names: bit n-1 is output n.
    """

    station_id: str
    target: str
    word: str
    mask: int


@dataclass(frozen=True, slots=True)
class InputState:
    """What an input has to read, so that a rule acts."""

    station_id: str
    channel: int
    on: bool


@dataclass(frozen=True, slots=True)
class RuleConfig:
    """A rule that the bridge carries out by itself, with a broker or without.

    Attributes:
        station_id: The station of its input.
        channel: Its input.
        event: What fires it: ON, OFF, short, long, double.
        orders: In the order of the file.
        conditions: Only while all of these inputs read so.
        broker_away: Only while the broker is away.
    """

    id: str
    name: str
    station_id: str
    channel: int
    event: str
    orders: tuple[RuleOrder, ...]
    conditions: tuple[InputState, ...] = ()
    broker_away: bool = False

    @property
    def trigger(self) -> tuple[str, int, str]:
        """Return what fires it: station, input and event."""
        return self.station_id, self.channel, self.event

    @property
    def station_ids(self) -> frozenset[str]:
        """Return the stations of all its parts."""
        ordered = (order.station_id for order in self.orders)
        return frozenset((self.station_id, *ordered, *(one.station_id for one in self.conditions)))


@dataclass(frozen=True, slots=True)
class Config:
    """A whole, valid configuration."""

    mqtt: MqttConfig
    homeassistant: HomeAssistantConfig
    state_dir: Path
    lines: tuple[LineConfig, ...]
    rules: tuple[RuleConfig, ...] = ()
    web: WebConfig | None = None  # None: there is no panel
    version: int = CURRENT_VERSION  # of the meaning of its keys

    def state_file(self, kind: str) -> Path:
        """Return the file of one kind of state: bridges of a machine differ in their base topic."""
        return self.state_dir / f"{kind}-{self.mqtt.base_topic.replace('/', '__')}.json"

    @property
    def all_stations(self) -> Iterator[tuple[LineConfig, StationConfig]]:
        """Yield each station with its line, in the order of the file."""
        return ((line, config) for line in self.lines for config in line.stations)

    @property
    def counted(self) -> list[tuple[str, int]]:
        """Return station id and channel of each counted input."""
        return [
            (config.id, channel.channel)
            for _, config in self.all_stations
            for channel in config.inputs
            if channel.count is not None
        ]
