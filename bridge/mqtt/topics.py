"""Every topic of the bridge: how it is written, and what an arriving one means."""

from dataclasses import dataclass
from enum import Enum
from typing import Literal

from bridge.config.names import MAX_ID_CHARACTERS
from bridge.model import Setting
from bridge.mqtt.events import Subscription

Direction = Literal["di", "do"]

# No model has a channel of three digits; the rest of a long one would only bloat verdicts.
_CHANNEL_CHARS = 32
_COVER_CHARS = MAX_ID_CHARACTERS + 1  # longer than any id, so that what is cut off is no cover
_POSITION: tuple[list[str], ...] = ([], ["position"])
_SETTINGS: tuple[list[str], ...] = ([], *([setting.value] for setting in Setting))


@dataclass(frozen=True, slots=True)
class CommandTarget:
    """Describe what a command topic names, not checked against any configuration.

    Attributes:
        station: The station as the topic writes it.
        channel: The channel as the topic writes it (`3`, but also `03`); None: several outputs.
        setting: Which setting of that output; None: its state.
    """

    station: str
    channel: str | None
    setting: Setting | None = None

    @property
    def name(self) -> str:
        """Return the target as a verdict repeats it."""
        if self.channel is None:
            return "do"
        return f"do/{self.channel}" + (f"/{self.setting}" if self.setting else "")

    @property
    def key(self) -> str:
        """Under which key of a JSON payload stands what is asked."""
        if self.channel is None:
            return "do"
        return self.setting or "state"


@dataclass(frozen=True, slots=True)
class CoverTarget:
    """Describe what a topic of commands to covers names, not checked against any configuration.

    Attributes:
        station: The station as the topic writes it.
        cover: The id of the cover as the topic writes it.
        position: A position is set, and not a word said.
    """

    station: str
    cover: str
    position: bool = False

    @property
    def name(self) -> str:
        """Return the target as a verdict repeats it."""
        return f"cover/{self.cover}"

    @property
    def key(self) -> str:
        """Under which key of a JSON payload stands what is asked."""
        return "position" if self.position else "state"


@dataclass(frozen=True, slots=True)
class RequestTarget:
    """Describe what a request to the bridge itself asks for, as its topic writes it."""

    verb: str


class OwnTopic(Enum):
    """Topics that the bridge itself publishes and listens to."""

    STATE = "state"
    PING = "ping"


class Topics:
    """The topics below one base topic (docs/topics.md)."""

    def __init__(self, base: str) -> None:
        self.base = base
        self.bridge_state = f"{base}/bridge/state"
        self.bridge_info = f"{base}/bridge/info"
        self.bridge_log = f"{base}/bridge/log"
        self.ping = f"{base}/bridge/ping"

    def request(self, verb: str) -> str:
        """Return where requests of one kind are asked."""
        return f"{self.base}/bridge/request/{verb}"

    def response(self, verb: str) -> str:
        """Return where requests of one kind are answered."""
        return f"{self.base}/bridge/response/{verb}"

    def line_availability(self, line: str) -> str:
        """Return whether the port of a line is there."""
        return f"{self.base}/bridge/line/{line}/availability"

    def line_diagnostics(self, line: str) -> str:
        """Counters and times of a line."""
        return f"{self.base}/bridge/line/{line}/diagnostics"

    def line_trace(self, line: str) -> str:
        """Return what passes on a line, while a client asks for it."""
        return f"{self.base}/bridge/line/{line}/trace"

    def snapshot(self, station: str) -> str:
        """Return all values of a module at once."""
        return f"{self.base}/{station}"

    def availability(self, station: str) -> str:
        """Return whether a module answers."""
        return f"{self.base}/{station}/availability"

    def channel(self, station: str, direction: Direction, channel: int) -> str:
        """Return the value of one input or output."""
        return f"{self.base}/{station}/{direction}/{channel}"

    def event(self, station: str, channel: int) -> str:
        """Return what was made of presses of an input."""
        return f"{self.channel(station, 'di', channel)}/event"

    def count(self, station: str, channel: int) -> str:
        """Return how often an input went ON."""
        return f"{self.channel(station, 'di', channel)}/count"

    def mode(self, station: str, output: int) -> str:
        """Latch or pulse, as read from the module."""
        return f"{self.base}/{station}/do/{output}/mode"

    def hold(self, station: str, output: int) -> str:
        """Return the hold time of an output, as read from the module."""
        return f"{self.base}/{station}/do/{output}/hold"

    def cover_state(self, station: str, cover: str) -> str:
        """Return what a cover does, or where it came to rest."""
        return f"{self.base}/{station}/cover/{cover}/state"

    def cover_position(self, station: str, cover: str) -> str:
        """Return where a cover is, in percent."""
        return f"{self.base}/{station}/cover/{cover}/position"

    def cover_commands(self, station: str, cover: str) -> str:
        """Return where a cover takes its commands."""
        return f"{self.base}/{station}/cover/{cover}/set"

    def problem(self, station: str) -> str:
        """Return whether a module needs its owner."""
        return f"{self.base}/{station}/problem"

    def diagnostics(self, station: str) -> str:
        """Counters and times of a module."""
        return f"{self.base}/{station}/diagnostics"

    def result(self, station: str) -> str:
        """Return the verdicts on commands to a module."""
        return f"{self.base}/{station}/result"

    def is_own(self, topic: str) -> bool:
        """Return whether `topic` is the base topic or lies below it."""
        return topic == self.base or topic.startswith(f"{self.base}/")

    def subscriptions(self, status_topic: str) -> tuple[Subscription, ...]:
        """Return what the bridge listens to. All of it live.

        What is retained is never a command.
        """
        filters = (
            f"{self.base}/+/do/+/set",
            f"{self.base}/+/set",
            f"{self.base}/+/do/+/mode/set",
            f"{self.base}/+/do/+/hold/set",
            f"{self.base}/+/cover/+/set",
            f"{self.base}/+/cover/+/position/set",
            f"{self.base}/bridge/request/+",
            self.bridge_state,
            self.ping,
        )
        return tuple(Subscription(topic) for topic in (*filters, status_topic))

    def parse(self, topic: str) -> CommandTarget | CoverTarget | RequestTarget | OwnTopic | None:
        """Tell what an arriving topic means; None: it is none of ours."""
        prefix = f"{self.base}/"
        if not topic.startswith(prefix):
            return None
        match topic.removeprefix(prefix).split("/"):
            case ["bridge", "state" | "ping" as own]:
                return OwnTopic(own)
            case ["bridge", "request", verb]:
                return RequestTarget(verb)
            case [station, *below, "set"]:
                return _command_target(station, below)
        return None


def _command_target(station: str, below: list[str]) -> CommandTarget | CoverTarget | None:
    """Return what stands between the station and `set`."""
    match below:
        case []:
            return CommandTarget(station, None)
        case ["do", channel, *setting] if setting in _SETTINGS:
            name = Setting(setting[0]) if setting else None
            return CommandTarget(station, channel[:_CHANNEL_CHARS], name)
        case ["cover", cover, *position] if position in _POSITION:
            return CoverTarget(station, cover[:_COVER_CHARS], bool(position))
    return None
