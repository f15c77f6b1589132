"""Reads the payload of a command. For any bytes, the only error is BadCommandError."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from bridge.config.durations import plain_seconds, tenths
from bridge.config.schema import StationConfig
from bridge.errors import CommandError
from bridge.model import (
    HOLD_DS,
    AnyCommand,
    Command,
    Reason,
    ReplyTo,
    Setting,
    SettingCommand,
    Word,
    bits_of,
)
from bridge.mqtt.cover_commands import COVER_WORDS, cover_command, goal_of, plain_wish
from bridge.mqtt.events import Received
from bridge.mqtt.strict_json import MOST_BYTES, JsonObject, bad, read_id, read_object, read_text
from bridge.mqtt.topics import CommandTarget, CoverTarget, Topics

PATIENCE_S = 2.0  # docs/contract.md, promise 2: from arrival, unless the command has a deadline
SHORTEST_DEADLINE_S = 0.1
LONGEST_DEADLINE_S = 60.0
_ECHO_CHARS = 256
_WORDS: frozenset[str] = frozenset(Word)
_VALUES: frozenset[str] = frozenset({Word.ON, Word.OFF})
_MODES = {"latch": 0, "pulse": 1}
_Make = Callable[[StationConfig, Mapping[str, Any]], AnyCommand]


class BadCommandError(CommandError):
    """A command that cannot be taken, and what of it could be read.

    Attributes:
        payload: What was asked, as far as it could be read: the verdict repeats it.
        id: The sender's own id, if it could be read.
    """

    def __init__(self, cause: CommandError, payload: Any, command_id: str | int | None) -> None:
        super().__init__(cause.reason, cause.detail)
        self.payload = payload
        self.id = command_id


def parse_command(
    target: CommandTarget | CoverTarget, received: Received, config: StationConfig, topics: Topics
) -> AnyCommand:
    """Return a command to the station of `config`, which `target` names.

    Raises:
        BadCommandError: It cannot be carried out.
    """
    payload: Any = _echo(received.payload)
    command_id: str | int | None = None
    try:
        request = _read(received.payload, target, config)
        command_id = read_id(request, "id")
        _check_keys(request, target)
        make = _understood(request, target, config)
        patience_s = _patience(request, received.expiry_s)
        payload = request[target.key]
        common: dict[str, Any] = {
            "station_id": config.id,
            "target": target.name,
            "payload": payload,
            "arrived": received.at,
            "deadline": received.at + patience_s,
            "id": command_id,
            "reply_to": reply_to(received, topics),
        }
        return make(config, common)
    except CommandError as error:
        raise BadCommandError(error, payload, command_id) from None


def _understood(
    request: Mapping[str, Any], target: CommandTarget | CoverTarget, config: StationConfig
) -> _Make:
    """Return a function that makes the command, once its common parts are known."""
    if isinstance(target, CoverTarget):
        return partial(cover_command, goal_of(request, target), target)
    return partial(_output_command, _asked(request, target, config), target)


def _output_command(
    asked: Mapping[str, Any],
    target: CommandTarget,
    config: StationConfig,
    common: Mapping[str, Any],
) -> AnyCommand:
    outputs = _outputs(asked, config)
    if target.setting is not None:
        ((output, value),) = outputs.items()
        return SettingCommand(output=output, setting=target.setting, value=value, **common)
    return Command(
        mask=bits_of(outputs),
        values=bits_of(n for n, word in outputs.items() if word in {Word.ON, Word.PRESS}),
        word=next((word for word in outputs.values() if word not in _VALUES), None),
        **common,
    )


def reply_to(received: Received, topics: Topics) -> ReplyTo | None:
    """Return the response topic of the sender, if a verdict may be sent there."""
    topic = received.response_topic
    # Brokers disconnect a client that publishes to a wildcard, NUL or `$` topic. Below our own base
    # topic a verdict would look like a state or a command.
    if not topic or topic.startswith("$") or any(char in topic for char in "+#\0"):
        return None
    reply = ReplyTo(topic, received.correlation or b"")
    too_long = len(topic) + len(reply.correlation) > MOST_BYTES
    return None if topics.is_own(topic) or too_long else reply


def _echo(payload: bytes) -> str:
    # A character has at most four bytes, so nothing that would be shown is cut off.
    return payload[: 4 * _ECHO_CHARS].decode("utf-8", errors="replace")[:_ECHO_CHARS]


def _read(payload: bytes, target: CommandTarget | CoverTarget, config: StationConfig) -> JsonObject:
    text = read_text(payload)
    plain = plain_wish(text, target) if isinstance(target, CoverTarget) else _plain(text, target)
    if plain is not None:
        return JsonObject({target.key: plain})
    return read_object(text, f"{_plain_words(target, config)}a JSON object")


def _plain_words(target: CommandTarget | CoverTarget, config: StationConfig) -> str:
    """Return the words of a payload without JSON, as the beginning of a list."""
    if isinstance(target, CoverTarget):
        return "0 to 100, or " if target.position else f"{COVER_WORDS}, or "
    match target.channel, target.setting:
        case None, _:
            return ""
        case _, Setting.MODE:
            return "latch, pulse, or "
        case _, Setting.HOLD:
            return "0.1-25.5 in steps of 0.1, or "
        case channel, _:
            return f"{_words_for(channel, config)}, or "


def _words_for(channel: str, config: StationConfig) -> str:
    """Return the words that are valid for one output, as far as the configuration says."""
    modes = {output.mode for output in config.outputs if str(output.channel) == channel}
    if modes == {"pulse"}:
        return "PRESS, ON, OFF"
    if modes == {"latch"}:
        return "ON, OFF, TOGGLE"
    return "ON, OFF, TOGGLE, PRESS (in pulse mode)"


def _plain(text: str, target: CommandTarget) -> str | float | None:
    """Return the meaning of a payload without JSON; None: it has none."""
    if target.channel is None:
        return None
    if target.setting is Setting.HOLD:
        return plain_seconds(text)
    return text if text in (_WORDS if target.setting is None else _MODES) else None


def _check_keys(request: JsonObject, target: CommandTarget | CoverTarget) -> None:
    for key in request:
        if key not in {target.key, "id", "deadline"}:
            raise bad(f"unknown key {key!a:.40}")
    if request.repeated:
        raise bad(f"key {min(request.repeated)!a} stands there twice")
    if target.key not in request:
        raise bad(f"key '{target.key}' is missing")


def _asked(
    request: Mapping[str, Any], target: CommandTarget, config: StationConfig
) -> dict[str, Any]:
    """Return the request for each channel: a word, or the value of a setting."""
    match target.channel, target.setting:
        case None, _:
            return _several(request)
        case channel, Setting.MODE:
            return {channel: _mode(request)}
        case channel, Setting.HOLD:
            return {channel: _hold_ds(request)}
        case channel, _:
            return {channel: _state(request, _words_for(channel, config))}


def _state(request: Mapping[str, Any], words: str) -> Word:
    state = request["state"]
    if not isinstance(state, str) or state not in _WORDS:
        raise bad(f"state is none of {words}")
    return Word(state)


def _mode(request: Mapping[str, Any]) -> int:
    mode = request["mode"]
    if not isinstance(mode, str) or mode not in _MODES:
        raise bad("mode is neither latch nor pulse")
    return _MODES[mode]


def _hold_ds(request: Mapping[str, Any]) -> int:
    hold_s = request["hold"]
    if isinstance(hold_s, bool) or not isinstance(hold_s, int | float):
        raise bad("hold is no number of seconds")
    hold_ds = tenths(hold_s)
    if hold_ds is None or hold_ds not in HOLD_DS:
        raise bad("hold is not within 0.1-25.5 s in steps of 0.1 s")
    return hold_ds


def _several(request: Mapping[str, Any]) -> dict[str, Word]:
    outputs = request["do"]
    if not isinstance(outputs, JsonObject) or not outputs:
        raise bad("'do' is no object with at least one output")
    if outputs.repeated:
        raise bad(f"output {min(outputs.repeated)!a:.40} stands there twice")
    for channel, value in outputs.items():
        if not isinstance(value, str) or value not in _VALUES:
            raise bad(f"output {channel!a:.40} is set to neither ON nor OFF")
    return {channel: Word(value) for channel, value in outputs.items()}


def _patience(request: Mapping[str, Any], expiry_s: int | None) -> float:
    deadline_s = request.get("deadline", PATIENCE_S)
    if isinstance(deadline_s, bool) or not isinstance(deadline_s, int | float):
        raise bad("deadline is no number")
    # NaN fails every comparison.
    if not SHORTEST_DEADLINE_S <= deadline_s <= LONGEST_DEADLINE_S:
        raise bad(f"deadline is not within {SHORTEST_DEADLINE_S}-{LONGEST_DEADLINE_S:.0f} s")
    return float(deadline_s if expiry_s is None else min(deadline_s, expiry_s))


def _outputs(asked: Mapping[str, Any], config: StationConfig) -> dict[int, Any]:
    # Compared as text, so that `01`, `1e0` or a digit of another script is not a channel.
    channels = {str(output.channel): output.channel for output in config.outputs}
    for name in asked:
        if name not in channels:
            raise CommandError(Reason.NO_SUCH_CHANNEL, f"no output {name!a:.40}")
    return {channels[name]: value for name, value in asked.items()}
