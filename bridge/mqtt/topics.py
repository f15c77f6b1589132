"""Every topic of the bridge: how it is written, and how an arriving one is read."""

from dataclasses import dataclass
from enum import Enum
from typing import Literal

from bridge.config.names import MAX_ID_CHARACTERS
from bridge.model import Setting
from bridge.mqtt.events import Subscription

Direction = Literal["di", "do"]

# No model has a channel with three digits; a longer one would only make verdicts long.
_CHANNEL_CHARS = 32
_COVER_CHARS = MAX_ID_CHARACTERS + 1  # longer than any id: a shortened one cannot equal a cover
_POSITION: tuple[list[str], ...] = ([], ["position"])
_SETTINGS: tuple[list[str], ...] = ([], *([setting.value] for setting in Setting))


@dataclass(frozen=True, slots=True)
class CommandTarget:
    """The target in a command topic, not yet checked against the configuration.

    Attributes:
        station_id: The station as in the topic.
        channel: The channel as in the topic (`3`, but also `03`); None: several outputs.
        setting: Which setting of that output; None: its state.
    """

    station_id: str
    channel: str | None
    setting: Setting | None = None

    @property
    def name(self) -> str:
        """Return the target as the verdict repeats it."""
        if self.channel is None:
            return "do"
        return f"do/{self.channel}" + (f"/{self.setting}" if self.setting else "")

    @property
    def key(self) -> str:
        """Return the key that holds the request in a JSON payload."""
        if self.channel is None:
            return "do"
        return self.setting or "state"


@dataclass(frozen=True, slots=True)
class CoverTarget:
    """The target in a topic of commands to covers, not yet checked against the configuration.

    Attributes:
        station_id: The station as in the topic.
        cover: The id of the cover as in the topic.
        position: The command sets a position.
    """

    station_id: str
    cover: str
    position: bool = False

    @property
    def name(self) -> str:
        """Return the target as the verdict repeats it."""
        return f"cover/{self.cover}"

    @property
    def key(self) -> str:
        """Return the key that holds the request in a JSON payload."""
        return "position" if self.position else "state"


@dataclass(frozen=True, slots=True)
class RequestTarget:
    """The verb in the topic of a request to the bridge."""

    verb: str


@dataclass(frozen=True, slots=True)
class RuleTarget:
    """The rule in the topic that switches it, not yet checked against the configuration."""

    rule: str


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
        """Return the topic for requests of one kind."""
        return f"{self.base}/bridge/request/{verb}"

    def response(self, verb: str) -> str:
        """Return the topic for answers of one kind."""
        return f"{self.base}/bridge/response/{verb}"

    def line_availability(self, line: str) -> str:
        """Return the topic for the port of a line."""
        return f"{self.base}/bridge/line/{line}/availability"

    def line_diagnostics(self, line: str) -> str:
        """Return the topic for the figures of a line."""
        return f"{self.base}/bridge/line/{line}/diagnostics"

    def line_trace(self, line: str) -> str:
        """Return the topic for the trace of a line."""
        return f"{self.base}/bridge/line/{line}/trace"

    def rule_state(self, rule: str) -> str:
        """Return the topic for a rule being switched on."""
        return f"{self.base}/bridge/rule/{rule}/state"

    def rule_event(self, rule: str) -> str:
        """Return the topic for what a rule does."""
        return f"{self.base}/bridge/rule/{rule}/event"

    def rule_commands(self, rule: str) -> str:
        """Return the topic that switches a rule."""
        return f"{self.base}/bridge/rule/{rule}/set"

    def snapshot(self, station_id: str) -> str:
        """Return the topic for all values of a module."""
        return f"{self.base}/{station_id}"

    def availability(self, station_id: str) -> str:
        """Return the topic for a module being online."""
        return f"{self.base}/{station_id}/availability"

    def channel(self, station_id: str, direction: Direction, channel: int) -> str:
        """Return the topic for one input or output."""
        return f"{self.base}/{station_id}/{direction}/{channel}"

    def event(self, station_id: str, channel: int) -> str:
        """Return the topic for presses of an input."""
        return f"{self.channel(station_id, 'di', channel)}/event"

    def count(self, station_id: str, channel: int) -> str:
        """Return the topic for the count of an input."""
        return f"{self.channel(station_id, 'di', channel)}/count"

    def mode(self, station_id: str, output: int) -> str:
        """Return the topic for the mode of an output."""
        return f"{self.channel(station_id, 'do', output)}/mode"

    def hold(self, station_id: str, output: int) -> str:
        """Return the topic for the hold time of an output."""
        return f"{self.channel(station_id, 'do', output)}/hold"

    def cover_state(self, station_id: str, cover: str) -> str:
        """Return the topic for the state of a cover."""
        return f"{self.base}/{station_id}/cover/{cover}/state"

    def cover_position(self, station_id: str, cover: str) -> str:
        """Return the topic for the position of a cover."""
        return f"{self.base}/{station_id}/cover/{cover}/position"

    def cover_commands(self, station_id: str, cover: str) -> str:
        """Return the topic for commands to a cover."""
        return f"{self.base}/{station_id}/cover/{cover}/set"

    def problem(self, station_id: str) -> str:
        """Return the topic for the problem of a module."""
        return f"{self.base}/{station_id}/problem"

    def diagnostics(self, station_id: str) -> str:
        """Return the topic for the figures of a module."""
        return f"{self.base}/{station_id}/diagnostics"

    def result(self, station_id: str) -> str:
        """Return the topic for verdicts on commands to a module."""
        return f"{self.base}/{station_id}/result"

    def own_actions(self, station_id: str) -> str:
        """Return the topic for what the bridge switched without a command."""
        return f"{self.base}/{station_id}/own_actions"

    def is_own(self, topic: str) -> bool:
        """Return whether `topic` is the base topic or is below it."""
        return topic == self.base or topic.startswith(f"{self.base}/")

    def subscriptions(self, status_topic: str) -> tuple[Subscription, ...]:
        """Return the subscriptions of the bridge: live messages only, so no retained commands."""
        filters = (
            f"{self.base}/+/do/+/set",
            f"{self.base}/+/set",
            f"{self.base}/+/do/+/mode/set",
            f"{self.base}/+/do/+/hold/set",
            f"{self.base}/+/cover/+/set",
            f"{self.base}/+/cover/+/position/set",
            f"{self.base}/bridge/rule/+/set",
            f"{self.base}/bridge/request/+",
            self.bridge_state,
            self.ping,
        )
        return tuple(Subscription(topic) for topic in (*filters, status_topic))

    def parse(
        self, topic: str
    ) -> CommandTarget | CoverTarget | RuleTarget | RequestTarget | OwnTopic | None:
        """Return the meaning of an arriving topic; None: it is not ours."""
        prefix = f"{self.base}/"
        if not topic.startswith(prefix):
            return None
        match topic.removeprefix(prefix).split("/"):
            case ["bridge", "state" | "ping" as own]:
                return OwnTopic(own)
            case ["bridge", "request", verb]:
                return RequestTarget(verb)
            case ["bridge", "rule", rule, "set"]:
                return RuleTarget(rule)
            case [station_id, *below, "set"]:
                return _command_target(station_id, below)
        return None


def _command_target(station_id: str, below: list[str]) -> CommandTarget | CoverTarget | None:
    """Return the target between the station and `set`."""
    match below:
        case []:
            return CommandTarget(station_id, None)
        case ["do", channel, *setting] if setting in _SETTINGS:
            name = Setting(setting[0]) if setting else None
            return CommandTarget(station_id, channel[:_CHANNEL_CHARS], name)
        case ["cover", cover, *position] if position in _POSITION:
            return CoverTarget(station_id, cover[:_COVER_CHARS], bool(position))
    return None
