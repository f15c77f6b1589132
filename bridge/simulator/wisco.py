"""Reads and answers Wisco frames as a module does (docs/protocol.md section 2).

The manual does not say which error code belongs to which fault. This simulator chose: a hex field
with a wrong character or length, or a wrong number of values, is 4 (invalid frame); channel 0 or 9
in WDO and an EEPROM number other than 0 are 2 (address); a byte count of 0 is 6; the checksum is
checked before the address.
"""

from collections.abc import Callable

from bridge.simulator.module import EEPROM_BYTES, SimulatedModule

CR = b"\r"
HEX = frozenset("0123456789ABCDEF")

ILLEGAL_FUNCTION = 1
ILLEGAL_ADDRESS = 2
ILLEGAL_VALUE = 3
INVALID_FRAME = 4
CHECKSUM_ERROR = 5
INVALID_COUNT = 6

SHORT_WRITE = 8  # the most bytes of a WEE in the dialect `wee-short`
WDO_CHANNELS = "12345678"  # one digit each, on the DO100 too


class _RefusalError(Exception):
    """The module does nothing and answers `ERR=` with this code."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(code)


def answer(module: SimulatedModule, frame: bytes, *, failing: bool = False) -> bytes | None:
    """Return the answer to a frame from `#` to CR; None: it is for another module.

    `failing`: it does nothing and refuses (the manual has no code for a failure).
    """
    if not frame.startswith(b"#%02X" % module.address):
        return None
    try:
        reply = _obey(module, frame, failing)
    except _RefusalError as refusal:
        reply = f"ERR={refusal.code}"
    return reply.encode("ascii") + CR


def _obey(module: SimulatedModule, frame: bytes, failing: bool) -> str:
    if failing:
        raise _RefusalError(ILLEGAL_VALUE)
    command = frame[3:-1].decode("latin-1")
    if command in READS:
        return READS[command](module)
    for name, write in COMMANDS.items():
        if command.startswith(name):
            return write(module, command.removeprefix(name), frame)
    raise _RefusalError(ILLEGAL_FUNCTION)


def _read_inputs(module: SimulatedModule) -> str:
    return "DI>" + _binary(module.inputs, _inputs_of(module))


def _read_inputs_hex(module: SimulatedModule) -> str:
    return f"DI>{module.inputs:0{_inputs_of(module) // 4}X}"


def _inputs_of(module: SimulatedModule) -> int:
    if not module.model.inputs:
        raise _RefusalError(ILLEGAL_FUNCTION)
    return module.model.inputs


def _read_outputs(module: SimulatedModule) -> str:
    return "DO>" + _binary(module.outputs, module.model.outputs)


def _read_outputs_hex(module: SimulatedModule) -> str:
    return f"DO>{module.outputs:0{module.model.outputs // 4}X}"


def _binary(bits: int, channels: int) -> str:
    return "".join("1" if bits >> n & 1 else "0" for n in reversed(range(channels)))


def _write_outputs(module: SimulatedModule, arguments: str, frame: bytes) -> str:
    channels, comma, values = arguments.partition(",")
    if not comma or not channels or len(channels) != len(values):
        raise _RefusalError(INVALID_FRAME)
    if any(channel not in WDO_CHANNELS for channel in channels):
        raise _RefusalError(ILLEGAL_ADDRESS)
    if any(value not in "01" for value in values):
        raise _RefusalError(ILLEGAL_VALUE)
    wanted = {int(channel): value == "1" for channel, value in zip(channels, values, strict=True)}
    mask = sum(1 << (channel - 1) for channel in wanted)
    bits = sum(1 << (channel - 1) for channel, on in wanted.items() if on)
    module.write_outputs(mask, bits, frame)
    return "DO>OK"


def _write_outputs_masked(module: SimulatedModule, arguments: str, frame: bytes) -> str:
    digits = module.model.outputs // 4
    mask, comma, values = arguments.partition(",")
    if not comma or len(mask) != digits or len(values) != digits:
        raise _RefusalError(INVALID_FRAME)
    module.write_outputs(_number(mask), _number(values), frame)
    return "DO>OK"


def _read_eeprom(module: SimulatedModule, arguments: str, _frame: bytes) -> str:
    if len(arguments) != len("0") + 4 + 4:
        raise _RefusalError(INVALID_FRAME)
    address, count = _number(arguments[1:5]), _number(arguments[5:9])
    if not count:
        raise _RefusalError(INVALID_COUNT)
    _check_address(arguments[0], address, count)
    data = module.read_eeprom(address, count)
    # [not stated] what this checksum covers: we take the data bytes.
    return f"EE>{data.hex().upper()}{checksum(data):02X}"


def _write_eeprom(module: SimulatedModule, arguments: str, _frame: bytes) -> str:
    number, body = arguments[:1], arguments[1:]
    if len(body) < 4 + 2 + 2:
        raise _RefusalError(INVALID_FRAME)
    address, count, end = _number(body[:4]), _number(body[4:6]), len(body) - 2
    _number(body[6:end] or "0")
    if "wee-count" in module.habits:  # the running text of the manuals: one more than the data
        count -= 1
    if "wee-short" in module.habits and count > SHORT_WRITE:
        raise _RefusalError(INVALID_COUNT)
    if not count or end - 6 != 2 * count:
        raise _RefusalError(INVALID_COUNT)
    if checksum(bytes.fromhex(body[:end])) != _number(body[end:]):
        raise _RefusalError(CHECKSUM_ERROR)
    _check_address(number, address, count)
    module.write_eeprom(address, bytes.fromhex(body[6:end]))
    return "EE>OK"


def _check_address(eeprom: str, address: int, count: int) -> None:
    if eeprom != "0" or address + count > EEPROM_BYTES:
        raise _RefusalError(ILLEGAL_ADDRESS)


def _number(digits: str) -> int:
    if not HEX.issuperset(digits):
        raise _RefusalError(INVALID_FRAME)
    return int(digits, 16)


def checksum(data: bytes) -> int:
    """Return the two's complement of the low 8 bits of the sum (docs/protocol.md section 2)."""
    return -sum(data) & 0xFF


READS: dict[str, Callable[[SimulatedModule], str]] = {
    "RDI": _read_inputs,
    "RDIH": _read_inputs_hex,
    "RDO": _read_outputs,
    "RDOH": _read_outputs_hex,
}
# WDOX before WDO, because WDO is a prefix of it.
COMMANDS: dict[str, Callable[[SimulatedModule, str, bytes], str]] = {
    "WDOX": _write_outputs_masked,
    "WDO": _write_outputs,
    "REE": _read_eeprom,
    "WEE": _write_eeprom,
}
