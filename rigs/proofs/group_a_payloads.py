"""A relay switched wrongly by what stands in a payload: A11."""

import random
import re

from support.virtual_line import VirtualLine
from support.virtual_worker import make_line, make_station

from bridge.config.schema import StationConfig
from bridge.line.actions.settings_write import SettingsWrite
from bridge.line.actions.writes import Write
from bridge.line.station import Station
from bridge.model import DIO100, DO100, Command, LineProtocol, ModuleType, Setting, SettingCommand
from bridge.mqtt.commands import BadCommandError, parse_command
from bridge.mqtt.events import Received
from bridge.mqtt.topics import CommandTarget, Topics
from bridge.simulator.framing import framer_for
from bridge.simulator.modbus import ascii_body
from proofs.figures import Figure, Run, proof

CHANNELS = ("1", "2", "8", "9", "16", "17", "01", "1\r", "1\r#02WDO1,1", "٣", "", "-1", "1e0")
WORDS = ("ON", "OFF", "TOGGLE", "PRESS", "on", "ON\r", "ON\r\n:01050000FF00FA\r\n", "#01WDO1,1\r")
SETTINGS = ("latch", "pulse", "2.5", "0.1", "25.5", "25.6", "1e1", "-1", "2.5\r", "pulse\r#01RDO\r")
PIECES = (b"\r", b"\n", b"#", b":", b",", b"\0", b'"', b"{", b"\xff", b"#01WDOXFF,FF\r", b"\\r")
_FRAMES = {
    (LineProtocol.WISCO, 8): rb"#(01|0D)(RDOH|WDOX[0-9A-F]{2},[0-9A-F]{2})\r",
    (LineProtocol.WISCO, 16): rb"#(01|0D)(RDOH|WDOX[0-9A-F]{4},[0-9A-F]{4})\r",
    (LineProtocol.MODBUS_ASCII, 8): rb":(01|0D)(01|03|05|06|0F)([0-9A-F]{2}){5,}\r\n",
    (LineProtocol.MODBUS_ASCII, 16): rb":(01|0D)(01|03|05|06|0F)([0-9A-F]{2}){5,}\r\n",
    (LineProtocol.MODBUS_RTU, 8): rb"(?s)[\x01\x0d][\x01\x03\x05\x06\x0f].{6,}",
    (LineProtocol.MODBUS_RTU, 16): rb"(?s)[\x01\x0d][\x01\x03\x05\x06\x0f].{6,}",
}


class _Payloads:
    """Payloads: right ones, wrong ones, and improbable ones."""

    def __init__(self, chance: random.Random) -> None:
        self._chance = chance

    def any(self, setting: Setting | None, *, several: bool) -> bytes:
        """One of them."""
        chance = self._chance
        if chance.random() < 0.1:
            return chance.randbytes(chance.randrange(40))
        payload = self._several() if several else self._single(setting)
        for _ in range(chance.choice((0, 0, 1, 2))):
            at = chance.randrange(len(payload) + 1)
            payload = payload[:at] + chance.choice(PIECES) + payload[at + chance.randrange(2) :]
        return payload

    def _single(self, setting: Setting | None) -> bytes:
        word = self._chance.choice(SETTINGS if setting else WORDS)
        if self._chance.random() < 0.5:
            return word.encode()
        return b'{"%b": "%b", "id": %d}' % (
            (setting or "state").encode(),
            word.encode(),
            self._chance.randrange(9**9),
        )

    def _several(self) -> bytes:
        channels = self._chance.choices(CHANNELS[:5], k=self._chance.randint(1, 4))
        if self._chance.random() < 0.3:
            channels[0] = self._chance.choice(CHANNELS)
        pairs = (f'"{channel}": "{self._chance.choice(WORDS[:2])}"' for channel in channels)
        return ('{"do": {' + ", ".join(pairs) + "}}").encode()


def _is_grammatical(frame: bytes, protocol: LineProtocol, model: ModuleType) -> bool:
    """Return whether a frame has the form of docs/protocol.md.

    Modules must also hear exactly this one frame.
    """
    if not re.fullmatch(_FRAMES[protocol, model.outputs], frame):
        return False
    framer = framer_for(protocol)
    heard = framer.feed(frame) + framer.silence()
    return heard == [frame] and (
        protocol is not LineProtocol.MODBUS_ASCII or ascii_body(frame) is not None
    )


class _Addressee:
    """One module of one line, and the frames that a command for it becomes."""

    def __init__(self, protocol: LineProtocol, config: StationConfig) -> None:
        line = make_line(config, protocol=protocol)
        self.protocol = protocol
        self.config = config
        self._station = Station(config, line)
        self._line = VirtualLine(line)

    def frames(self, channel: str | None, setting: Setting | None, payload: bytes) -> list[bytes]:
        """Carries out what the payload asks for, or raises BadCommandError."""
        line = self._line
        command = parse_command(
            CommandTarget(self.config.id, channel, setting),
            Received("", payload, retain=False, at=line.now),
            self.config,
            Topics("wisco"),
        )
        line.wire.clear()
        if isinstance(command, SettingCommand):
            SettingsWrite(command, self._station, line, line.clock).run()
        elif isinstance(command, Command):
            Write([command], self._station, line, line.clock, lambda _: False).run()
        return [frame for _, frame in line.wire]


@proof("A11")
def payloads_make_no_frames(run: Run) -> Figure:
    """The content of a payload never gets into a frame; only its meaning does."""
    chance = random.Random(11)  # noqa: S311  # cases, not secrets
    payloads = _Payloads(chance)
    stations = [
        _Addressee(protocol, config)
        for protocol in LineProtocol
        for config in (make_station(1, DIO100), make_station(13, DO100))
    ]
    count = run.scale.of(20_000, 1_000_000)
    taken = frames = outside = 0
    for n in range(count):
        station = stations[n % len(stations)]
        channel = chance.choice((None, chance.choice(CHANNELS)))
        try:
            setting = chance.choice((None, *Setting)) if channel else None
            sent = station.frames(channel, setting, payloads.any(setting, several=channel is None))
        except BadCommandError:
            continue
        taken += 1
        frames += len(sent)
        outside += sum(
            not _is_grammatical(frame, station.protocol, station.config.model) for frame in sent
        )
    return Figure(
        injected=f"{count} payloads, of which {taken} were commands",
        seen=f"{outside} of {frames} frames outside the grammar",
        promised="0 frames outside the grammar",
        kept=outside == 0 and count // 20 < taken < count // 2,
    )
