"""Frozen values that every part speaks in, and that alone cross from one thread to another.

Channels are held as bits of an int: bit n-1 is channel n, a set bit is ON.
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
    """Describe what the frames of a line look like: DIP switch 8 (docs/protocol.md section 1)."""

    WISCO = "wisco"
    MODBUS_RTU = "modbus-rtu"
    MODBUS_ASCII = "modbus-ascii"


class Writes(StrEnum):
    """In which frames writes go on a Wisco line (docs/contract.md, promise 6)."""

    AUTO = "auto"
    WISCO = "wisco"
    MODBUS = "modbus"


BAUD_RATES = (4800, 9600, 19200, 57600)
USUAL_BAUD = 9600
LAST_ADDRESS = (
    31  # DIP switches 1-5; 0 is a module too, but Modbus' broadcast (docs/failures.md A9)
)
HOLD_DS = range(1, 256)  # docs/protocol.md section 3: a register holds tenths of a second


def bit(channel: int) -> int:
    """Return the bit of a channel that counts from 1."""
    return 1 << (channel - 1)


def bits_of(channels: Iterable[int]) -> int:
    """Return the bits of some channels, each named once: what `channels_of` takes apart again."""
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
    """The port of a line came or went."""

    line: str
    online: bool
    detail: str


@dataclass(frozen=True, slots=True)
class StationChanged:
    """A module became reachable (after its first good reads) or is not any more."""

    station: str
    online: bool
    detail: str


@dataclass(frozen=True, slots=True)
class ValuesChanged:
    """Describe what a station's channels are now, confirmed and as they are to be published."""

    station: str
    inputs: int
    outputs: int


class Gesture(StrEnum):
    """Describe what a press of a button was (docs/topics.md: `B/S/di/n/event`)."""

    SHORT = "short"
    LONG = "long"
    DOUBLE = "double"


@dataclass(frozen=True, slots=True)
class GestureMade:
    """An input that is a button was pressed in one of the ways that mean something."""

    station: str
    channel: int
    gesture: Gesture


@dataclass(frozen=True, slots=True)
class InputsRose:
    """Inputs whose edges are counted went ON: bit n-1 for input n. A first value is no edge."""

    station: str
    channels: int


@dataclass(frozen=True, slots=True)
class CountChanged:
    """Tell how often an input went ON, in all."""

    station: str
    channel: int
    edges: int


@dataclass(frozen=True, slots=True)
class SettingsRead:
    """Modes and hold times were read, or could not be (None)."""

    station: str
    settings: OutputSettings | None


class CoverState(StrEnum):
    """Describe what a cover does, or where it came to rest (the words of its topic)."""

    OPEN = "open"
    OPENING = "opening"
    CLOSED = "closed"
    CLOSING = "closing"
    STOPPED = "stopped"


@dataclass(frozen=True, slots=True)
class CoverChanged:
    """Describe what a cover does, and where it is in percent, 100 open; None: it is not known."""

    station: str
    cover: str
    state: CoverState
    position: int | None


@dataclass(frozen=True, slots=True)
class LossOrderMade:
    """`on_loss` switched an output, or may have started its pulse: not again in this loss."""

    station: str
    output: int


@dataclass(frozen=True, slots=True)
class ProblemChanged:
    """Something about a station needs its owner (`reason` set), or does not any more (None)."""

    station: str
    reason: str | None
    detail: str


# --- how lines and stations are doing ---------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Spread:
    """Durations in two figures, in seconds: half were shorter than one, 99 % than the other."""

    p50_s: float
    p99_s: float


@dataclass(frozen=True, slots=True)
class ExchangeCounts:
    """Describe how exchanges went, counted since the start."""

    good: int
    silent: int
    bad: int
    refused: int


@dataclass(frozen=True, slots=True)
class LineMeasured:
    """Describe how a line did in the period that ended just now.

    Attributes:
        cycle: One round: everything that answers was read once. None: no round was finished.
        utilisation: The share of the time in which an exchange was under way.
        counts: Of all its stations.
        unsolicited_bytes: Bytes that were not requested, counted since the start.
    """

    line: str
    cycle: Spread | None
    utilisation: float
    counts: ExchangeCounts
    unsolicited_bytes: int


@dataclass(frozen=True, slots=True)
class StationMeasured:
    """Describe how a station did in the period that ended just now. Instants are monotonic seconds.

    Attributes:
        poll: Between two reads of its inputs, or of its outputs. None: there were none.
        reply: From a request to the end of its reply. None: it gave no reply.
        bound_s: What `poll` should not exceed, as the plan has it.
        age_s: The longest that any of its channels went unread; None: it is not online.
        last_error: Why it last gave no valid reply; None: it always did.
        last_seen: When it last gave one; None: never.
    """

    station: str
    poll: Spread | None
    reply: Spread | None
    bound_s: float
    age_s: float | None
    counts: ExchangeCounts
    last_error: str | None
    last_seen: float | None


# --- what passes on a line --------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class LinePassed:
    """Bytes that passed on a line, told while a client asks for it.

    Attributes:
        at: When, in monotonic seconds: as the port took them, or handed them over.
        sent: They went to the modules; else they came from them.
    """

    line: str
    at: float
    data: bytes
    sent: bool


# --- what becomes of a command ----------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ReplyTo:
    """Describe where an MQTT v5 requester wants its verdict besides `B/S/result`."""

    topic: str
    correlation: bytes


class Word(StrEnum):
    """The closed words of a command to one output."""

    ON = "ON"
    OFF = "OFF"
    TOGGLE = "TOGGLE"
    PRESS = "PRESS"


@dataclass(frozen=True, slots=True)
class _CommandBase:
    """What every command has. Instants are monotonic seconds.

    Attributes:
        station: The station id.
        target: `do/3`, `do` for several outputs in one write, `do/3/mode`, or `cover/shutter`:
            the verdict repeats it.
        payload: What was asked, as the verdict repeats it: the word, or the object.
        arrived: When it arrived.
        deadline: Nothing is sent after this instant.
        id: The sender's own id, or None.
        reply_to: A further topic for its verdict.
    """

    station: str
    target: str
    payload: Any
    _: KW_ONLY
    arrived: float
    deadline: float
    id: str | int | None = None
    reply_to: ReplyTo | None = None


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
    """Describe what can be set of one output besides its state."""

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
        """Return the output that it names, as a bit."""
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
    """Describe how a command ended (docs/topics.md, Verdicts)."""

    DONE = "done"
    FAILED = "failed"
    REFUSED = "refused"
    UNKNOWN = "unknown"


class Reason(StrEnum):
    """Describe why a command was not `done` (docs/topics.md, Verdicts)."""

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
    """Describe what became of one command: exactly one for each that arrives.

    Attributes:
        ms: Milliseconds from its arrival to this verdict.
        code: The module's own code, where it refused.
        seen_on: For pulses: whether the read after the write still saw it ON.
        by: Which key of the configuration ordered it; None: a command did.
    """

    station: str
    target: str
    payload: Any
    status: Status
    ms: int
    reason: Reason | None = None
    id: str | int | None = None
    code: int | None = None
    seen_on: bool | None = None
    detail: str | None = None
    reply_to: ReplyTo | None = None
    by: str | None = None


StateEvent = (
    LineChanged
    | StationChanged
    | ValuesChanged
    | GestureMade
    | SettingsRead
    | CoverChanged
    | ProblemChanged
    | LineMeasured
    | StationMeasured
    | Verdict
)
LineEvent = StateEvent | InputsRose | LossOrderMade
PublicEvent = StateEvent | CountChanged
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
        station=command.station,
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
    )


@dataclass(frozen=True, slots=True)
class LeftCover:
    """A cover whose motor may run when its line ends: who comes after stops it."""

    address: int
    station: str
    cover: str

    def __str__(self) -> str:
        return f"station {self.address} ({self.station}): cover {self.cover}"


Orders = frozenset[tuple[str, int]]


LeftCovers = tuple[LeftCover, ...]
