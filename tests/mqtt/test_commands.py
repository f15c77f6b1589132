import json
import random
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.mqtt_side import GARAGE

from bridge.config.schema import OutputConfig
from bridge.model import AnyCommand, Command, Reason, ReplyTo, Setting, SettingCommand, Word
from bridge.mqtt import payloads
from bridge.mqtt.commands import BadCommandError, parse_command, reply_to
from bridge.mqtt.events import Received
from bridge.mqtt.topics import CommandTarget, Topics

TOPICS = Topics("wisco")
TOO_LONG = "x" * 4097
LAMP = CommandTarget("garage", "1")
ALL = CommandTarget("garage", None)
MODE = CommandTarget("garage", "4", Setting.MODE)
HOLD = CommandTarget("garage", "4", Setting.HOLD)


def _received(payload: bytes, **properties: Any) -> Received:
    return Received("any", payload, retain=False, at=100.0, **properties)


def _parse_any(payload: bytes | str, target: CommandTarget, **properties: Any) -> AnyCommand:
    data = payload.encode() if isinstance(payload, str) else payload
    return parse_command(target, _received(data, **properties), GARAGE, TOPICS)


def _parse(payload: bytes | str, target: CommandTarget = LAMP, **properties: Any) -> Command:
    command = _parse_any(payload, target, **properties)
    assert isinstance(command, Command)
    return command


def _error_of(payload: bytes | str, target: CommandTarget = LAMP) -> BadCommandError:
    with pytest.raises(BadCommandError) as caught:
        _parse_any(payload, target)
    return caught.value


# --- one output --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("word", "values", "special"),
    [
        ("ON", 0b1000, None),
        ("OFF", 0, None),
        ("TOGGLE", 0, Word.TOGGLE),
        ("PRESS", 0b1000, Word.PRESS),
    ],
)
def test_a_word(word: str, values: int, special: Word | None) -> None:
    """Each word, bare or in JSON, asks for the same."""
    target = CommandTarget("garage", "4")
    command = _parse(word, target)
    assert command == Command(
        station_id="garage",
        target="do/4",
        payload=word,
        mask=0b1000,
        values=values,
        word=special,
        arrived=100.0,
        deadline=102.0,
    )
    assert _parse(json.dumps({"state": word}), target) == command


def test_a_json_command_has_id_and_deadline() -> None:
    """`id` is kept as it came, and `deadline` replaces the 2 s."""
    command = _parse('{"state": "ON", "id": "x1", "deadline": 0.5}')
    assert (command.id, command.deadline, command.payload) == ("x1", 100.5, "ON")


@pytest.mark.parametrize(
    ("payload", "expiry_s", "left_s"),
    [
        ("ON", None, 2.0),
        ("ON", 60, 2.0),
        ("ON", 1, 1.0),
        ('{"state": "ON", "deadline": 60}', None, 60.0),
        ('{"state": "ON", "deadline": 60}', 5, 5.0),
        ('{"state": "ON", "deadline": 0.1}', 1, 0.1),
        ('{"state": "ON", "deadline": 1.5}', 1, 1.0),
    ],
)
def test_the_time_that_is_left(payload: str, expiry_s: int | None, left_s: float) -> None:
    """2 s, or the command's own deadline; never after its message expiry."""
    assert _parse(payload, expiry_s=expiry_s).deadline == pytest.approx(100.0 + left_s)


BAD = {
    LAMP: [
        "", " ", "on", "On", "ON ", " ON", "ON\n", "ON\r#02WDO1,1", "1", "true", "null", '"ON"',
        "[]", '["ON"]', "{}", "NaN", "{", '{"state": "ON"} x', '{"state": "ON"}{"state": "ON"}',
        '{"state": "on"}', '{"state": true}', '{"state": null}', '{"state": ["ON"]}',
        '{"state": {}}', '{"State": "ON"}', '{"state": "ON", "x": 1}', '{"do": {"1": "ON"}}',
        '{"state": "ON", "state": "OFF"}', "{'state': 'ON'}", '{"state": "ON",}',
        '{"state": "ON", "id": null}', '{"state": "ON", "id": true}', '{"state": "ON", "id": 1.5}',
        '{"state": "ON", "id": ""}', '{"state": "ON", "id": []}', '{"state": "ON", "id": {}}',
        '{"state": "ON", "id": "\\ud800"}', '{"state": "ON", "id": "a", "id": "b"}',
        '{"state": "ON", "deadline": 0.09}', '{"state": "ON", "deadline": 60.01}',
        '{"state": "ON", "deadline": -1}', '{"state": "ON", "deadline": true}',
        '{"state": "ON", "deadline": "1"}', '{"state": "ON", "deadline": NaN}',
        '{"state": "ON", "deadline": Infinity}', '{"state": "ON", "deadline": 1e999}',
        '{"state": "ON", "deadline": null}', '{"id": "x"}', "\ufeffON",
        '\ufeff{"state": "ON"}', "[" * 4000, '{"a":' * 800, "9" * 4096, "-" + "9" * 4000,
        '{"state": "ON", "id": "' + "x" * 129 + '"}', '{"state": "ON", "id": ' + "1" * 129 + "}",
        "ON\0", "\0",
    ],
    ALL: [
        "ON", "{}", '{"do": {}}', '{"do": []}', '{"do": "ON"}', '{"do": null}',
        '{"do": {"1": "TOGGLE"}}', '{"do": {"1": "PRESS"}}', '{"do": {"1": true}}',
        '{"do": {"1": ["ON"]}}', '{"do": {"1": "ON", "1": "OFF"}}', '{"state": "ON"}',
        '{"do": {"1": "ON"}, "state": "ON"}', '{"do": {"1": "ON"}, "do": {"2": "ON"}}',
        '{"di": {"1": "ON"}}', '{"do": {"99": "on"}}',
    ],
    MODE: [
        "", "Pulse", "PULSE", "pulse ", "ON", "1", "true", '"pulse"', '{"mode": 1}', "{}",
        '{"mode": "PULSE"}', '{"state": "pulse"}', '{"hold": 1}', '{"mode": "pulse", "x": 1}',
        '{"mode": "pulse", "mode": "latch"}', '{"mode": ["pulse"]}', '{"mode": null}', "0.5",
    ],
    HOLD: [
        "", "0", "0.0", "0.05", "0.55", "25.6", "26", "99.9", "100", "-1", "+1", "1.", ".5", "1,5",
        "1e0", "1.0s", " 1", "1 ", "1\n", "pulse", "NaN", "\u0663", '{"hold": 0}', '{"hold": 0.05}',
        '{"hold": 0.55}', '{"hold": 25.6}', '{"hold": 1e999}', '{"hold": NaN}', '{"hold": true}',
        '{"hold": "0.5"}', '{"hold": null}', '{"hold": -0.5}', '{"state": 0.5}', '{"mode": 0.5}',
        '{"hold": ' + "9" * 4000 + "}",
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ("target", "payload"), [(target, payload) for target, bad in BAD.items() for payload in bad]
)
def test_bad_payloads(target: CommandTarget, payload: str) -> None:
    """What does not ask for what its topic is for is `bad_payload`, with its first characters."""
    error = _error_of(payload, target)
    assert (error.reason, error.payload) == (Reason.BAD_PAYLOAD, payload[:256])


@pytest.mark.parametrize(
    "payload",
    [b"\xff", b"ON\xff", b"O\x00N\x00", '{"state": "ON"}'.encode("utf-16"), b"\xed\xa0\x80"],
)
def test_bytes_that_are_not_utf8(payload: bytes) -> None:
    """Bytes that are no text are shown with replacement characters."""
    error = _error_of(payload)
    assert error.reason == Reason.BAD_PAYLOAD
    assert error.payload == payload.decode(errors="replace")


def test_a_long_payload_is_not_read() -> None:
    """Over 4096 bytes nothing is parsed, and only the beginning is shown, in whole characters."""
    error = _error_of('{"state": "ON", "id": "x"}' + " " * 5000)
    assert (error.reason, error.id) == (Reason.BAD_PAYLOAD, None)
    assert "5026 bytes" in error.detail
    assert _error_of("é" * 3000).payload == "é" * 256
    assert _error_of("😀" * 3000).payload == "😀" * 256


@pytest.mark.parametrize("command_id", ["x", "x" * 128, "ประตู", "a\nb", 0, -1, 10**127])
def test_good_ids(command_id: str | int) -> None:
    """Texts of 1 to 128 characters and integers are marks."""
    made = _parse(json.dumps({"state": "ON", "id": command_id})).id
    assert made == command_id
    assert type(made) is type(command_id)


@pytest.mark.parametrize(
    "payload",
    [
        '{"state": "BLINK", "id": "x1"}',
        '{"id": "x1"}',
        '{"id": "x1", "state": "ON", "state": "ON"}',
        '{"state": "ON", "id": "x1", "deadline": 99}',
        '{"state": "ON", "id": "x1", "more": {}}',
    ],
)
def test_a_bad_command_keeps_its_id(payload: str) -> None:
    """A refused command is recognisable whenever its id could be read."""
    error = _error_of(payload)
    assert (error.reason, error.id, error.payload) == (Reason.BAD_PAYLOAD, "x1", payload)


@pytest.mark.parametrize(
    "channel", ["3", "9", "0", "01", "1.0", "1e0", "+1", " 1", "\u0661", "", "x", "1" * 32]
)
@pytest.mark.parametrize(
    ("setting", "payload", "shown"),
    [
        (None, '{"state": "ON", "id": 7}', "ON"),
        (Setting.MODE, '{"mode": "pulse", "id": 7}', "pulse"),
        (Setting.HOLD, '{"hold": 0.5, "id": 7}', 0.5),
    ],
)
def test_no_such_channel(
    channel: str, setting: Setting | None, payload: str, shown: str | float
) -> None:
    """What is left out, unknown or no plain decimal; among several it spoils the whole command."""
    error = _error_of(payload, CommandTarget("garage", channel, setting))
    assert (error.reason, error.payload, error.id) == (Reason.NO_SUCH_CHANNEL, shown, 7)
    outputs = {"1": "ON", channel: "ON"}
    error = _error_of(json.dumps({"do": outputs, "id": 7}), ALL)
    assert (error.reason, error.payload, error.id) == (Reason.NO_SUCH_CHANNEL, outputs, 7)


# --- several outputs ---------------------------------------------------------------------------


def test_several_outputs() -> None:
    """One command sets several outputs; its verdict repeats the object."""
    command = _parse('{"do": {"4": "ON", "1": "OFF", "2": "ON"}, "id": 5, "deadline": 1}', ALL)
    assert command == Command(
        station_id="garage",
        target="do",
        payload={"4": "ON", "1": "OFF", "2": "ON"},
        mask=0b1011,
        values=0b1010,
        word=None,
        arrived=100.0,
        deadline=101.0,
        id=5,
    )


# --- where the verdict goes --------------------------------------------------------------------


def test_a_response_topic_is_kept() -> None:
    """An MQTT v5 requester gets its verdict where it asked for it."""
    command = _parse("ON", response_topic="me/replies", correlation=b"\0\xff")
    assert command.reply_to == ReplyTo("me/replies", b"\0\xff")


def test_long_correlation_data_get_no_answer_of_their_own() -> None:
    """With correlation data that are too long the verdict only goes to the result topic."""
    assert _parse("ON", response_topic="r", correlation=b"x" * 4096).reply_to is None


def test_correlation_may_be_missing() -> None:
    """A response topic of its own is enough for a requester."""
    asked = _received(b"ON", response_topic="wisco2/replies")
    assert reply_to(asked, TOPICS) == ReplyTo("wisco2/replies", b"")


@pytest.mark.parametrize(
    "topic",
    [
        None,
        "",
        "a/+/b",
        "a/#",
        "a\0b",
        "$SYS/x",
        "wisco",
        "wisco/garage/do/1/set",
        "wisco/x",
        TOO_LONG,
    ],
)
def test_bad_response_topics_are_ignored(topic: str | None) -> None:
    """No verdict goes to wildcards, the broker's own topics, below the base topic or far away."""
    assert _parse("ON", response_topic=topic, correlation=b"x").reply_to is None


# --- whatever comes ----------------------------------------------------------------------------

_any: st.SearchStrategy[Any] = (
    st.sampled_from(["ON", 1, 0.05, 61, float("nan"), True, None, [], {}, [1], "\ud800", ""])
    | st.floats() | st.integers() | st.text(max_size=200)
)  # fmt: skip
_words = st.sampled_from([*Word, "ON", "OFF"])
_outputs = st.dictionaries(st.sampled_from(["1", "2", "3", "04"]), _words | _any, max_size=3)
_noise = st.binary(max_size=300) | st.text(max_size=300).map(
    lambda text: text.encode(errors="surrogatepass")
)


def _near(channel: str | None) -> st.SearchStrategy[tuple[str | None, bytes]]:
    """Payloads that are nearly, or quite, a command to this channel."""
    asked = {"do": _outputs | _any} if channel is None else {"state": _words | _any}
    request = st.fixed_dictionaries(asked, optional={"id": _any, "deadline": _any})
    payload = request.map(lambda value: json.dumps(value).encode()) | _noise
    return st.tuples(st.just(channel), payload)


_cases = st.sampled_from([None, "1", "3", "4", "9" * 30]).flatmap(_near)


def _outcome(payload: bytes, target: CommandTarget) -> Command | BadCommandError:
    try:
        return _parse(payload, target)
    except BadCommandError as error:
        return error


def _check(payload: bytes, channel: str | None) -> None:
    made = _outcome(payload, CommandTarget("garage", channel))
    assert json.loads(payloads.as_json({"payload": made.payload, "id": made.id}))["id"] == made.id
    if isinstance(made, BadCommandError):
        assert made.reason in {Reason.BAD_PAYLOAD, Reason.NO_SUCH_CHANNEL}
        return
    assert made.mask
    assert not made.mask & ~0b1011
    assert not made.values & ~made.mask
    assert made.arrived + 0.1 <= made.deadline <= made.arrived + 60.0
    assert channel is None or made.mask == 1 << (int(channel) - 1)


@settings(max_examples=150)
@given(_cases)
def test_whatever_comes_is_a_command_or_a_refusal(case: tuple[str | None, bytes]) -> None:
    """Any bytes give a sound command or a refusal that can be published, never anything else."""
    channel, payload = case
    _check(payload, channel)


def test_damaged_commands_are_commands_or_refusals() -> None:
    """Good commands with bytes changed, cut or doubled: a sound command or a refusal."""
    good = [b"ON", b"TOGGLE", b'{"state": "ON", "id": "x\\u00e9", "deadline": 1.5}']
    good += [b'{"do": {"1": "ON", "4": "OFF"}, "id": -17}']
    chance = random.Random(1)  # noqa: S311  # repeatable damage, no secret
    for _ in range(10_000):
        payload = bytearray(chance.choice(good))
        for _ in range(chance.randint(1, 3)):
            at = chance.randrange(len(payload) + 1)
            mark = bytes([chance.choice(b'{}[]",:0e-')])
            new = chance.choice([b"", mark, chance.randbytes(1), bytes(payload[at:])])
            payload[at : at + chance.randint(0, 2)] = new
        _check(bytes(payload), chance.choice([None, "1", "3"]))


# --- modes and hold times ------------------------------------------------------------------------


@pytest.mark.parametrize(("word", "value"), [("latch", 0), ("pulse", 1)])
def test_a_mode(word: str, value: int) -> None:
    """Each word, bare or in JSON, asks for the same."""
    command = _parse_any(word, MODE)
    assert command == SettingCommand(
        station_id="garage",
        target="do/4/mode",
        payload=word,
        output=4,
        setting=Setting.MODE,
        value=value,
        arrived=100.0,
        deadline=102.0,
    )
    assert _parse_any(json.dumps({"mode": word}), MODE) == command
    assert command.mask == 0b1000


@pytest.mark.parametrize("tenths", [1, 2, 3, 7, 10, 25, 100, 254, 255])
def test_a_hold_time(tenths: int) -> None:
    """Seconds with a decimal or without, bare or in JSON; the verdict repeats the number."""
    text = f"{tenths // 10}.{tenths % 10}"
    command = _parse_any(text, HOLD)
    assert isinstance(command, SettingCommand)
    assert (command.target, command.payload, command.value) == ("do/4/hold", float(text), tenths)
    assert _parse_any(f'{{"hold": {text}}}', HOLD) == command
    if tenths % 10 == 0:
        assert _parse_any(str(tenths // 10), HOLD) == command


def test_a_setting_has_id_deadline_and_expiry_too() -> None:
    """A setting has id, deadline and expiry, as other commands."""
    text = '{"hold": 0.5, "id": "x1", "deadline": 1.5}'
    command = _parse_any(text, HOLD, expiry_s=1, response_topic="node-red/1")
    assert (command.id, command.deadline) == ("x1", 101.0)
    assert command.reply_to == ReplyTo("node-red/1", b"")


@pytest.mark.parametrize(
    ("number", "tenths"),
    [("0.30000000000000004", 3), ("2.3000000000000003", 23), ("3.00", 30), ("0.1000", 1)],
)
def test_a_hold_time_as_programs_write_it(number: str, tenths: int) -> None:
    """A hold time with a rounding error of binary fractions is accepted, also in JSON."""
    for payload in (number, f'{{"hold": {number}}}'):
        command = _parse_any(payload, HOLD)
        assert isinstance(command, SettingCommand)
        assert command.value == tenths


def test_a_hold_time_between_two_steps_is_told_the_steps() -> None:
    """The detail names them."""
    for payload in ("0.55", '{"hold": 0.55}'):
        assert "in steps of 0.1 s" in str(_error_of(payload, HOLD).detail)


@pytest.mark.parametrize("payload", ["on", "On", '{"state": "on"}', "true", '"ON"'])
@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("pulse", "PRESS, ON, OFF"),
        ("latch", "ON, OFF, TOGGLE"),
        (None, "ON, OFF, TOGGLE, PRESS (in pulse mode)"),
    ],
)
def test_what_is_no_word_is_answered_with_the_words(
    payload: str, mode: str | None, words: str
) -> None:
    """The refusal of an unknown word lists the valid words for that output."""
    outputs = (OutputConfig(4, mode=mode),)
    config = replace(GARAGE, outputs=outputs)
    with pytest.raises(BadCommandError) as caught:
        parse_command(CommandTarget("garage", "4"), _received(payload.encode()), config, TOPICS)
    assert words in caught.value.detail


@given(payload=st.binary(max_size=200))
def test_no_payload_of_a_setting_raises_anything_else(payload: bytes) -> None:
    """For any payload of a setting, the only error is BadCommandError."""
    for target in (MODE, HOLD):
        try:
            command = _parse_any(payload, target)
        except BadCommandError:
            continue
        assert isinstance(command, SettingCommand)
        assert 0 <= command.value <= 255
