"""Operation: E5, garbage, floods and framing errors. The real bus in virtual time."""

import random
from collections import Counter
from typing import Any

from support.virtual_line import reply_of
from support.virtual_port import Chunk, VirtualPort, VirtualTime

from bridge.config.schema import LineConfig
from bridge.errors import BadReplyError, NoReplyError, RefusedError
from bridge.model import DIO100, DO100, LineProtocol
from bridge.protocol import modbus, wisco, wisco_eeprom
from bridge.protocol.ascii import AsciiRequest
from bridge.protocol.request import Request
from bridge.protocol.rtu import RtuRequest
from bridge.simulator.module import SimulatedModule
from bridge.transport.bus import bus_of
from proofs.figures import Figure, Run, proof

STATION = 7
REQUESTS: tuple[Request[Any], ...] = (
    wisco.ReadInputsHex(STATION),
    *(wisco.ReadOutputsHex(STATION, module) for module in (DIO100, DO100)),
    wisco.WriteOutputsMasked(STATION, DO100, 0x8B73, 0x8B72),
    wisco_eeprom.ReadEeprom(STATION, 0x700, 8),
    wisco_eeprom.WriteEeprom(STATION, 0x100, b"\x12\x34"),
    *(
        framing(STATION, pdu)
        for framing in (RtuRequest, AsciiRequest)
        for pdu in (
            modbus.ReadCoils(0, 8),
            modbus.ReadDiscreteInputs(0, 16),
            modbus.ReadHoldingRegisters(0, 9),
            modbus.WriteCoil(0, True),
            modbus.WriteRegister(1, 25),
            modbus.WriteCoils(0, 8, 0x72),
        )
    ),
)
FLOOD_BYTES = 6000  # more than anything reads in one go
# A reply, what may stand before it, what drains away after it.
TAKEN_AT_MOST_S = 2.0


def _good_replies(request: Request[Any]) -> list[bytes]:
    """Return the answers of modules by the simulator: a good reply, and a refusal."""
    modules = [SimulatedModule(model, STATION) for model in (DIO100, DO100)]
    replies = (
        reply_of(module, request.frame, failing=failing)
        for module in modules
        for failing in (False, True)
    )
    return [reply for reply in replies if reply]


class _Streams:
    """Draws byte streams: pure garbage, damaged replies, and mixtures of both."""

    def __init__(self, chance: random.Random) -> None:
        self._chance = chance
        self._own = {request.frame: _good_replies(request) for request in REQUESTS}
        self._all = [reply for replies in self._own.values() for reply in replies]
        self._fitting = self._all
        kinds = (self._garbage, self._damaged, self._mixture)
        self._kinds = (*kinds * 33, self._flood)

    def draw(self, frame: bytes) -> list[Chunk]:
        """A stream after this request, as it arrives: in one to four pieces, with pauses."""
        self._fitting = self._own[frame]
        data = self._chance.choice(self._kinds)()
        chunks, at = [], 0.0
        for _ in range(self._chance.randint(0, 3)):
            size = self._chance.randint(0, len(data))
            chunks.append((at, data[:size]))
            data = data[size:]
            at += self._chance.random() * 0.05
        return [*chunks, (at, data)]

    def _reply(self) -> bytes:
        return self._chance.choice(self._fitting if self._chance.random() < 0.7 else self._all)

    def _garbage(self) -> bytes:
        return self._chance.randbytes(self._chance.randint(0, 40))

    def _damaged(self) -> bytes:
        reply = bytearray(self._reply())
        for _ in range(self._chance.randint(1, 3)):
            at = self._chance.randrange(len(reply) + 1)
            match self._chance.randrange(4):
                case 0:
                    reply[at:at] = self._chance.randbytes(1)
                case 1:
                    del reply[at : at + self._chance.randint(1, 4)]
                case 2 if at < len(reply):
                    reply[at] ^= 1 << self._chance.randrange(8)
                case _:
                    reply += reply[at:]
        return bytes(reply)

    def _mixture(self) -> bytes:
        parts = (self._garbage, self._damaged, self._reply)
        return b"".join(self._chance.choice(parts)() for _ in range(self._chance.randint(1, 3)))

    def _flood(self) -> bytes:
        piece = self._damaged() or b"\xff"
        return (piece * FLOOD_BYTES)[:FLOOD_BYTES]


class _Target:
    """A bus of one protocol, and the port under it that says what is drawn."""

    def __init__(self, protocol: LineProtocol, streams: _Streams) -> None:
        self.time = VirtualTime()
        self.port = VirtualPort(self.time, streams.draw)
        line = LineConfig("main", "virtual", 57600, protocol, stations=())
        self.bus = bus_of(line, self.port, self.time.clock, self.time.sleep)

    def fuzz(self, request: Request[Any], echo: bool | None) -> str:
        """One exchange; tells how it ended."""
        self.bus.echo = echo
        self.port.sent.clear()
        began = self.time.now
        try:
            self.bus.exchange(request, protected=not isinstance(request, wisco.WiscoRequest))
            ended = "read"
        except NoReplyError:
            ended = "silent"
        except BadReplyError:
            ended = "bad"
        except RefusedError:
            ended = "refused"
        except Exception as error:  # noqa: BLE001  # a crash is what is looked for
            ended = f"crash: {error!r} on {request}"
        if self.time.now - began > TAKEN_AT_MOST_S:
            return f"crash: it took {self.time.now - began:.1f} s"
        return ended


@proof("E5")
def the_line_babbles(run: Run) -> Figure:
    """For any bytes on the line an exchange soon ends in a value or in one of three errors."""
    count = run.scale.of(5_000, 1_000_000)
    chance = random.Random(5)  # noqa: S311  # no secret
    streams = _Streams(chance)
    targets = [_Target(protocol, streams) for protocol in LineProtocol]
    ended: Counter[str] = Counter()
    for n in range(count):
        request = REQUESTS[n % len(REQUESTS)]
        echo = chance.choice((None, False, False, True))
        ended[chance.choice(targets).fuzz(request, echo)] += 1
    crashes = {how: times for how, times in ended.items() if how.startswith("crash")}
    print("\n".join(list(crashes)[:10]), end="")
    return Figure(
        injected=f"{count} streams into the bus and {len(REQUESTS)} readers",
        seen=f"{sum(crashes.values())} crashes; {ended['read']} read, {ended['refused']} refused",
        promised="0 crashes",
        # Streams that were all garbage at the first look would prove little.
        kept=not crashes and min(ended["read"], ended["refused"]) > count // 100,
    )
