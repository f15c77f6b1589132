"""Frozen values that all parts use; commands and events cross between threads in them.

Channels are the bits of an int: bit n-1 is channel n, a set bit is ON.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import KW_ONLY, dataclass
from enum import StrEnum
from typing import Any


@dataclass(frozen=True, slots=True)
class ModuleType:
    """A kind of module and its channel counts (docs/protocol.md section 1)."""

    name: str
    inputs: int
    outputs: int


DIO100 = ModuleType("DIO100", inputs=16, outputs=8)
DO100 = ModuleType("DO100", inputs=0, outputs=16)
MODULE_TYPES = {module.name: module for module in (DIO100, DO100)}


class LineProtocol(StrEnum):
    """The protocol of a line: DIP switch 8 (docs/protocol.md section 1)."""

    WISCO = "wisco"
    MODBUS_RTU = "modbus-rtu"
    MODBUS_ASCII = "modbus-ascii"

    @property
    def in_modbus(self) -> "LineProtocol":
        """Return the Modbus protocol that modules of such a line take."""
        return LineProtocol.MODBUS_ASCII if self is LineProtocol.WISCO else self


class Writes(StrEnum):
    """The frames for writes on a Wisco line (docs/contract.md, promise 6)."""

    AUTO = "auto"
    WISCO = "wisco"
    MODBUS = "modbus"


BAUD_RATES = (4800, 9600, 19200, 57600)
USUAL_BAUD = 9600
# DIP switches 1-5; 0 is a module too, but Modbus' broadcast (docs/failures.md A9).
LAST_ADDRESS = 31
HOLD_DS = range(1, 256)  # docs/protocol.md section 3: a register holds tenths of a second


def bit(channel: int) -> int:
    """Return the bit of a channel that counts from 1."""
    return 1 << (channel - 1)


def bits_of(channels: Iterable[int]) -> int:
    """Return the bits of some channels, each named once; the inverse of `channels_of`."""
    return sum(bit(channel) for channel in channels)


def channels_of(bits: int) -> Iterator[int]:
    """Yield the channels, counted from 1, whose bits are set."""
    channel = 1
    while bits:
        if bits & 1:
            yield channel
        bits >>= 1
        channel += 1


@dataclass(frozen=True, slots=True)
class OutputSettings:
    """Modes and hold times as a module holds them in its EEPROM (docs/protocol.md section 3).

    Attributes:
        pulse: Bit n-1 set: output n is in pulse mode.
        hold_ds: Hold time of each output, in tenths of a second, output 1 first.
    """

    pulse: int
    hold_ds: tuple[int, ...]


# --- what line workers tell the hub -----------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LineChanged:
    """The port of a line was opened or lost."""

    line: str
    online: bool
    detail: str


@dataclass(frozen=True, slots=True)
class StationChanged:
    """A module came online (after its first good reads) or went offline."""

    station_id: str
    online: bool
    detail: str


@dataclass(frozen=True, slots=True)
class ValuesChanged:
    """The present channels of a station, confirmed and ready to publish."""

    station_id: str
    inputs: int
    outputs: int


class Gesture(StrEnum):
    """A press of a button (docs/topics.md: `B/S/di/n/event`)."""

    SHORT = "short"
    LONG = "long"
    DOUBLE = "double"


@dataclass(frozen=True, slots=True)
class GestureMade:
    """A button was pressed."""

    station_id: str
    channel: int
    gesture: Gesture


@dataclass(frozen=True, slots=True)
class InputsRose:
    """Counted inputs went ON: bit n-1 for input n. The first value is not an edge."""

    station_id: str
    channels: int


@dataclass(frozen=True, slots=True)
class CountChanged:
    """Tell how often an input went ON, in all."""

    station_id: str
    channel: int
    edges: int


@dataclass(frozen=True, slots=True)
class SettingsRead:
    """Modes and hold times were read, or could not be (None)."""

    station_id: str
    settings: OutputSettings | None


class CoverState(StrEnum):
    """The movement of a cover, or the place where it stopped: the words of its topic."""

    OPEN = "open"
    OPENING = "opening"
    CLOSED = "closed"
    CLOSING = "closing"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class CoverChanged:
    """The state of a cover, and its position in percent (100 open; None: not known)."""

    station_id: str
    cover: str
    state: CoverState
    position: int | None


@dataclass(frozen=True, slots=True)
class LossOrderMade:
    """`on_loss` switched an output, or may have started its pulse: not again in this loss."""

    station_id: str
    output: int


@dataclass(frozen=True, slots=True)
class RuleFired:
    """The input of a rule did what the rule waits for.

    Attributes:
        rule: Its id.
        held: Why the rule orders nothing; None: its orders follow, each with a verdict.
    """

    rule: str
    held: str | None = None


@dataclass(frozen=True, slots=True)
class RuleDue:
    """The event of a rule with parts on several lines: the main thread carries it out.

    Attributes:
        rule: Its id.
        trigger: Station, input and event, by which the configuration of another moment is told.
        seen_at: When a read showed it.
        deadline: Nothing is sent after this instant.
    """

    rule: str
    trigger: tuple[str, int, str]
    seen_at: float
    deadline: float


@dataclass(frozen=True, slots=True)
class RuleSwitched:
    """Tell whether a rule is switched on."""

    rule: str
    on: bool


@dataclass(frozen=True, slots=True)
class ProblemChanged:
    """A station has a problem (`reason` is set), or has none any more (None)."""

    station_id: str
    reason: str | None
    detail: str


# --- how lines and stations are doing ---------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Spread:
    """A distribution in two figures, in seconds: the median and the 99th percentile."""

    p50_s: float
    p99_s: float


@dataclass(frozen=True, slots=True)
class ExchangeCounts:
    """Results of exchanges, counted since the start."""

    good: int
    silent: int
    bad: int
    refused: int


@dataclass(frozen=True, slots=True)
class LineMeasured:
    """The figures of a line for the period that just ended.

    Attributes:
        cycle: The time in which everything that answers was read once. None: no cycle was
            completed.
        utilisation: The share of the time in which an exchange was in progress.
        counts: The exchanges of all its stations.
        unsolicited_bytes: Bytes that were not requested, counted since the start.
    """

    line: str
    cycle: Spread | None
    utilisation: float
    counts: ExchangeCounts
    unsolicited_bytes: int


@dataclass(frozen=True, slots=True)
class Learned:
    """The times in force for one module where they are learned; None: it is not learned."""

    turnaround_s: float | None
    late_window_s: float | None
    silence_s: float | None


NOTHING_LEARNED = Learned(None, None, None)


@dataclass(frozen=True, slots=True)
class StationMeasured:
    """The figures of a station for the period that just ended. Instants: `bridge.clock.boot_s`.

    Attributes:
        poll: The time between two reads of its inputs, or of its outputs. None: there were none.
        reply: The time from a request to the end of its reply. None: there was no reply.
        bound_s: The limit that the plan sets for `poll`.
        age_s: The longest time that a channel was not read; None: it is not online.
        last_error: Why it last gave no valid reply; None: that never happened.
        last_seen: The instant of its last valid reply; None: never.
        learned: The times that `auto` gave it.
    """

    station_id: str
    poll: Spread | None
    reply: Spread | None
    bound_s: float
    age_s: float | None
    counts: ExchangeCounts
    last_error: str | None
    last_seen: float | None
    learned: Learned = NOTHING_LEARNED


# --- what passes on a line --------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LinePassed:
    """Bytes that passed on a line, reported while a client asks for it.

    Attributes:
        at: When the port took them or returned them (`bridge.clock.boot_s`).
        sent: True: they went to the modules; False: they came from them.
    """

    line: str
    at: float
    data: bytes
    sent: bool


@dataclass(frozen=True, slots=True)
class MainWork:
    """Work that another thread hands to the main thread: it does not block, and raises nothing."""

    do: Callable[[], None]


# --- what becomes of a command ----------------------------------------------------------------


BY_PANEL = "panel"  # `by` of a verdict on a command of the panel in the browser


@dataclass(frozen=True, slots=True)
class Ticket:
    """The number by which the panel finds the verdict on its command."""

    number: int


@dataclass(frozen=True, slots=True)
class ReplyTo:
    """The MQTT 5 response topic to which the verdict goes as well as to `B/S/result`."""

    topic: str
    correlation: bytes


class Word(StrEnum):
    """The words of a command to one output."""

    ON = "ON"
    OFF = "OFF"
    TOGGLE = "TOGGLE"
    PRESS = "PRESS"


@dataclass(frozen=True, slots=True)
class _CommandBase:
    """What every command has. Instants are monotonic seconds.

    Attributes:
        station_id: The station id.
        target: `do/3`, `do` for several outputs in one write, `do/3/mode`, or `cover/shutter`:
            the verdict repeats it.
        payload: What was asked, as the verdict repeats it: the word, or the object.
        arrived: When it arrived.
        deadline: Nothing is sent after this instant.
        id: The sender's own id, or None.
        reply_to: A further topic for its verdict, or the ticket of the panel.
        by: The rule that ordered it (`rule NAME`); None: it came over MQTT or from the panel.
    """

    station_id: str
    target: str
    payload: Any
    _: KW_ONLY
    arrived: float
    deadline: float
    id: str | int | None = None
    reply_to: ReplyTo | Ticket | None = None
    by: str | None = None


@dataclass(frozen=True, slots=True)
class Command(_CommandBase):
    """One command to outputs of one station, as it arrived.

    Attributes:
        mask: The outputs that it names.
        values: Their wanted values (0 outside the mask, and all 0 for TOGGLE).
        word: TOGGLE or PRESS where that was asked, else None.
    """

    mask: int
    values: int
    word: Word | None


class Setting(StrEnum):
    """A setting of an output: its mode, or its hold time."""

    MODE = "mode"
    HOLD = "hold"


@dataclass(frozen=True, slots=True)
class SettingCommand(_CommandBase):
    """One command to set a mode or a hold time, as it arrived.

    Attributes:
        output: Which output.
        setting: Which of its settings.
        value: A mode: 1 for pulse, 0 for latch. A hold time: tenths of a second.
    """

    output: int
    setting: Setting
    value: int

    @property
    def mask(self) -> int:
        """Return the output as a bit."""
        return bit(self.output)


@dataclass(frozen=True, slots=True)
class CoverCommand(_CommandBase):
    """One command to a cover, as it arrived.

    Attributes:
        cover: The id of the cover within its station.
        mask: Its two outputs.
        goal: Where it should be, 0 closed to 100 open; None: where it is.
    """

    cover: str
    mask: int
    goal: int | None


AnyCommand = Command | SettingCommand | CoverCommand


class Status(StrEnum):
    """The result of a command (docs/topics.md, Verdicts)."""

    DONE = "done"
    FAILED = "failed"
    REFUSED = "refused"
    UNKNOWN = "unknown"


class Reason(StrEnum):
    """The reason why a command was not `done` (docs/topics.md, Verdicts)."""

    NO_REPLY = "no_reply"
    MODULE_REFUSED = "module_refused"
    NOT_CONFIRMED = "not_confirmed"
    PORT_DOWN = "port_down"
    RETAINED = "retained"
    EXPIRED = "expired"
    STALE_LINK = "stale_link"
    DUPLICATE = "duplicate"
    SUPERSEDED = "superseded"
    BAD_PAYLOAD = "bad_payload"
    NO_SUCH_CHANNEL = "no_such_channel"
    READ_ONLY = "read_only"
    BUSY = "busy"
    RATE_LIMITED = "rate_limited"
    INTERLOCK = "interlock"
    WRONG_MODEL = "wrong_model"
    OFFLINE = "offline"
    STOPPING = "stopping"


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on a command: exactly one for each command that arrives.

    Attributes:
        ms: Milliseconds from its arrival to this verdict.
        code: The error code of the module, if it refused.
        seen_on: For pulses: whether the read after the write still saw it ON.
        by: The key of the configuration that ordered it, the rule (`rule NAME`), or `panel`; None:
            an MQTT client did.
    """

    station_id: str
    target: str
    payload: Any
    status: Status
    ms: int
    reason: Reason | None = None
    id: str | int | None = None
    code: int | None = None
    seen_on: bool | None = None
    detail: str | None = None
    reply_to: ReplyTo | Ticket | None = None
    by: str | None = None

    @property
    def is_own(self) -> bool:
        """Return whether the bridge ordered it by itself."""
        return self.by not in {None, BY_PANEL}


StateEvent = (
    LineChanged
    | StationChanged
    | ValuesChanged
    | GestureMade
    | SettingsRead
    | CoverChanged
    | RuleFired
    | ProblemChanged
    | LineMeasured
    | StationMeasured
    | Verdict
)
LineEvent = StateEvent | InputsRose | LossOrderMade | RuleDue
PublicEvent = StateEvent | CountChanged | RuleSwitched
# Called by the main thread alone, in the order in which things happened; it does not block.
Publish = Callable[[PublicEvent], None]


def verdict_on(
    command: AnyCommand,
    now: float,
    status: Status,
    reason: Reason | None = None,
    *,
    code: int | None = None,
    seen_on: bool | None = None,
    detail: str | None = None,
) -> Verdict:
    """Return the verdict on `command`, given at `now`."""
    return Verdict(
        station_id=command.station_id,
        target=command.target,
        payload=command.payload,
        status=status,
        ms=round((now - command.arrived) * 1000),
        reason=reason,
        id=command.id,
        code=code,
        seen_on=seen_on,
        detail=detail,
        reply_to=command.reply_to,
        by=BY_PANEL if isinstance(command.reply_to, Ticket) else command.by,
    )


@dataclass(frozen=True, slots=True)
class LeftCover:
    """A cover whose motor may still run when its line ends: the next line stops it."""

    address: int
    station_id: str
    cover: str

    def __str__(self) -> str:
        return f"station {self.address} ({self.station_id}): cover {self.cover}"


@dataclass(frozen=True, slots=True)
class StandingCover:
    """A cover that was read to stand when its line ended: the next line knows where it is.

    Attributes:
        build: Its outputs and times: another build has another way.
        position: In percent, 100 open.
    """

    address: int
    station_id: str
    cover: str
    build: str
    position: float


Orders = frozenset[tuple[str, int]]


LeftCovers = tuple[LeftCover, ...]
StandingCovers = tuple[StandingCover, ...]
