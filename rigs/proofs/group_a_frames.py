"""A relay switched wrongly by a frame that should not be: A7, A9."""

import random
from collections.abc import Iterator
from typing import Any

from support.bus_worker import BusWorker, Script
from support.config_file import problems_of
from support.virtual_worker import make_line, make_station

from bridge.drivers import driver_for
from bridge.drivers.driver import Driver
from bridge.model import DIO100, DO100, LineProtocol, ModuleType
from bridge.protocol.ascii import AsciiRequest
from bridge.protocol.modbus import Pdu, ReadCoils, WriteCoil, WriteCoils, WriteRegister
from bridge.protocol.rtu import RtuRequest
from bridge.simulator import modbus, wisco
from bridge.simulator.faults import FaultKind, is_write
from bridge.simulator.framing import framer_for
from bridge.simulator.module import SimulatedModule, Switching
from proofs.figures import Figure, Run, Scale, proof

Order = tuple[int, int, bool]  # station, output, value

# --- A7 ---------------------------------------------------------------------------------------


class _Cabinet:
    """A module at every station, and what a frame does to any of them."""

    def __init__(self, protocol: LineProtocol, model: ModuleType) -> None:
        self._protocol = protocol
        self._orders: set[Order] = set()
        self._modules = {
            address: SimulatedModule(model, address, listener=self._note) for address in range(32)
        }

    def hear(self, data: bytes) -> set[Order]:
        """Return what a module makes of bytes that a silence follows."""
        self._orders = set()
        framer = framer_for(self._protocol)
        for frame in framer.feed(data) + framer.silence():
            if not _is_whole(frame):
                continue  # no module looks further
            called = framer.address(frame)
            for address, module in self._modules.items():
                if called in (address, modbus.BROADCAST):
                    self._answer(module, frame)
        return self._orders

    def _answer(self, module: SimulatedModule, frame: bytes) -> None:
        if frame.startswith(b"#"):
            wisco.answer(module, frame)
        elif frame.startswith(b":"):
            modbus.answer_ascii(module, frame)
        else:
            modbus.answer_rtu(module, frame)

    def _note(self, address: int, switching: Switching) -> None:
        self._orders.add((address, switching.output, switching.value))


def _is_whole(frame: bytes) -> bool:
    return not frame.startswith(b":") or modbus.ascii_body(frame) is not None


def _writes(driver: Driver) -> Iterator[bytes]:
    """Each output of a module ON and OFF, and each range of outputs ON, OFF and by turns."""
    outputs = driver.module.outputs
    for first in range(outputs):
        for count in range(1, outputs - first + 1):
            mask = ((1 << count) - 1) << first
            for values in {mask, 0, mask & 0x5555}:
                yield driver.write_outputs(mask, values, 0).frame


def _flips(frame: bytes) -> Iterator[bytes]:
    for at in range(8 * len(frame)):
        damaged = bytearray(frame)
        damaged[at // 8] ^= 1 << at % 8
        yield bytes(damaged)


def _wrong_flips(protocol: LineProtocol, scale: Scale) -> tuple[int, int]:
    """Return damaged frames, and how many of them caused a wrong switching."""
    flips = wrong = 0
    for model in (DIO100, DO100):
        cabinet = _Cabinet(protocol, model)
        for address in range(1, 32, scale.of(30, 3)):
            for frame in list(_writes(driver_for(protocol, address, model)))[:: scale.of(9, 1)]:
                meant = cabinet.hear(frame)
                assert meant, f"{frame!r} was to switch something"
                for damaged in _flips(frame):
                    flips += 1
                    wrong += not cabinet.hear(damaged) <= meant
    return flips, wrong


def _damaged_commands(worker: BusWorker, bits: range, wrong: list[Order]) -> Script:
    """Each output ON and OFF, each time with another bit of the write flipped."""
    for output in range(1, DIO100.outputs + 1):
        for values in (1 << (output - 1), 0):
            for bit in bits:
                worker.bus_line.faults.set(FaultKind.FLIP_REQUEST, bit=bit, only=is_write)
                yield worker.command(1 << (output - 1), values)
                for address, module in worker.line.modules.items():
                    did = {(address, *order) for order in module.ordered}
                    wrong += did - {(1, output, values != 0)}
                    module.ordered.clear()


@proof("A7")
def flipped_bits_of_writes(run: Run) -> Figure:
    """No single bit turns a write in Modbus frames into another one, on a Wisco line neither."""
    rtu, rtu_wrong = _wrong_flips(LineProtocol.MODBUS_RTU, run.scale)
    ascii_, ascii_wrong = _wrong_flips(LineProtocol.MODBUS_ASCII, run.scale)
    bare, bare_wrong = _wrong_flips(LineProtocol.WISCO, run.scale)
    # Stations that differ from station 1 in one bit of their address.
    stations = [make_station(address) for address in (1, 3, 5, 9, 17)]
    worker = BusWorker(make_line(*stations))
    wrong: list[Order] = []
    worker.follow(_damaged_commands(worker, range(0, 8 * 17, run.scale.of(17, 1)), wrong))
    struck = worker.bus_line.faults.struck[FaultKind.FLIP_REQUEST]
    by_modbus = rtu_wrong + ascii_wrong + len(wrong)
    return Figure(
        injected=f"every bit of every write: {rtu + ascii_ + bare} flips",
        seen=f"{by_modbus} wrong by Modbus writes (by Wisco: {100 * bare_wrong / bare:.1f} %)",
        promised="0 by Modbus writes, on Wisco lines too",
        kept=by_modbus == 0 and struck > 0 and bare_wrong > 0,
    )


# --- A9 ---------------------------------------------------------------------------------------


def _any_pdu(chance: random.Random) -> Pdu[Any]:
    address = chance.randrange(16)
    count = chance.randint(1, 16)
    return chance.choice(
        (
            ReadCoils(address, count),
            WriteCoil(address, chance.random() < 0.5),
            WriteCoils(address, count, chance.randrange(1 << count)),
            WriteRegister(address, chance.randrange(256)),
        )
    )


def _frame(address: int, pdu: Pdu[Any], *, rtu: bool) -> bytes:
    return (RtuRequest(address, pdu) if rtu else AsciiRequest(address, pdu)).frame


def _address(frame: bytes) -> int:
    return int(frame[1:3], 16) if frame.startswith(b":") and len(frame) > 8 else frame[0]


def _tame_commands(worker: BusWorker, count: int) -> Script:
    for n in range(count):
        bit = 1 << n % DIO100.outputs
        yield worker.command(bit, bit if n & DIO100.outputs else 0, station_id="s0")


@proof("A9")
def station_0_is_no_broadcast(run: Run) -> Figure:
    """No Modbus frame with address 0 is built, for any request to any station."""
    chance = random.Random(9)  # noqa: S311  # cases, not secrets
    built = refused = broadcasts = 0
    for _ in range(run.scale.of(10_000, 300_000)):
        address = chance.choice((0, chance.randrange(32), chance.randint(-600, 600)))
        try:
            frame = _frame(address, _any_pdu(chance), rtu=chance.choice((True, False)))
        except ValueError:
            refused += 1
            continue
        built += 1
        broadcasts += _address(frame) == modbus.BROADCAST
    # A station 0 that takes Modbus frames all the same is never asked for that.
    worker = BusWorker(make_line(make_station(0), make_station(1)))
    worker.follow(_tame_commands(worker, run.scale.of(20, 500)))
    frames = [frame for _, frame in worker.line.wire]
    broadcasts += sum(frame.startswith(b":00") for frame in frames)
    reached = sum(frame.startswith(b"#00WDO") for frame in frames)
    admitted = sum(
        not problems_of(run.directory, _house_with_station_0(line))
        for line in ("protocol: modbus-rtu", "protocol: modbus-ascii", "writes: modbus")
    )
    return Figure(
        injected=f"{built + refused} frames, {len(frames)} on a line with a station 0",
        seen=f"{broadcasts} of {built + len(frames)} with address 0, {refused} refused",
        promised="0 Modbus frames with address 0",
        kept=broadcasts == 0 and admitted == 0 and built > 0 and refused > 0 and reached > 0,
    )


def _house_with_station_0(line: str) -> str:
    protocol = "" if line.startswith("protocol") else "    protocol: wisco\n"
    return (
        "lines:\n  - id: main\n    port: /dev/ttyUSB0\n    baud: 9600\n"
        f"{protocol}    {line}\n    stations:\n      - {{address: 0, model: DIO100}}\n"
    )
