"""What verify asks a module by reads alone: one function for each assumption."""

import re
from collections.abc import Callable, Iterator
from functools import partial

from bridge.commission.eeprom import READ_BLOCK_BYTES, Eeprom
from bridge.commission.verify.assumptions import (
    ASSUMPTIONS,
    Finding,
    as_assumed,
    differs,
    not_tried,
)
from bridge.commission.verify.talk import SILENT, Talk, agreed
from bridge.drivers.modbus import ModbusDriver
from bridge.errors import ExchangeError
from bridge.model import DIO100, LineProtocol
from bridge.protocol.checksum import wisco_checksum
from bridge.protocol.modbus import ReadCoils, ReadDiscreteInputs, ReadHoldingRegisters
from bridge.protocol.request import Request
from bridge.protocol.wisco import ReadInputsHex, ReadOutputsHex

_NO_WISCO = "a Modbus RTU line has no Wisco frames"
_NO_ANSWER = "no two answers agreed, or none came"
_PAST_THE_END = "REE007FF0002"  # a read beyond the EEPROM: it changes nothing
_BLOCK_AT, _BLOCK_BYTES = 0x0010, 16
_SHORT_BLOCK = 32  # where polls and commands wait meanwhile
_OUTSIDE = 0x1000  # no coil is there
_UPPER, _LOWER = re.compile(rb"[A-F]"), re.compile(rb"[a-f]")


def read_questions(talk: Talk) -> Iterator[Finding]:
    """Ask all that reads can tell, and say of the rest why it is not tried."""
    for assumption in ASSUMPTIONS.values():
        if assumption.untried:
            yield not_tried(assumption.id, assumption.untried)
        elif ask := QUESTIONS.get(assumption.id):
            yield ask(talk)


# --- the form of Wisco replies ---


def _err_end(talk: Talk) -> Finding:
    if not talk.is_text:
        return not_tried("err-end", _NO_WISCO)

    def ask() -> str | None:
        heard = talk.wisco(_PAST_THE_END)
        found = re.search(rb"ERR=[0-9](\r\n?)?$", heard)
        if found is None:
            return None if heard else SILENT
        return "CR follows" if found[1] else "nothing follows"

    return _judged("err-end", agreed(ask), "CR follows")


def _line_end(talk: Talk) -> Finding:
    if not talk.is_text:
        return not_tried("line-end", _NO_WISCO)

    def ask() -> str | None:
        heard = talk.wisco("RDO")
        found = re.search(rb"DO>[01]+(\r\n?)$", heard)
        if found is None:
            return None if heard else SILENT
        return "CR LF" if found[1] == b"\r\n" else "CR alone"

    return _judged("line-end", agreed(ask), "CR alone")


def _hex_case(talk: Talk) -> Finding:
    if not talk.is_text:
        return not_tried("hex-case", "there are no hex digits in Modbus RTU")
    reads: list[Callable[[], bytes]] = [
        partial(talk.wisco, f"REE0{at:04X}0010") for at in (_BLOCK_AT, 0, 0x0700)
    ]
    if talk.takes_modbus:
        reads += [
            partial(talk.ascii, ReadCoils(0, talk.model.outputs)),
            partial(talk.ascii, ReadHoldingRegisters(0, 1 + talk.model.outputs)),
        ]
    for read in reads:
        if case := agreed(lambda read=read: _case_of(read())):  # type: ignore[misc]
            return _judged("hex-case", case, "upper case")
    return not_tried("hex-case", "no digit above 9 came in any answer")


def _case_of(heard: bytes) -> str | None:
    body = re.search(rb"(?:EE>|:)([0-9A-Fa-f]+)\r", heard)
    if body is None:
        return None if heard else SILENT
    upper, lower = bool(_UPPER.search(body[1])), bool(_LOWER.search(body[1]))
    if upper and lower:
        return "both cases"
    return "upper case" if upper else "lower case" if lower else None


def _ree_checksum(talk: Talk) -> Finding:
    if not talk.is_text:
        return not_tried("ree-checksum", _NO_WISCO)

    def ask() -> str | None:
        chars = 2 * _BLOCK_BYTES + 8
        heard = talk.wisco(f"REE0{_BLOCK_AT:04X}{_BLOCK_BYTES:04X}", chars)
        found = re.search(rb"EE>((?:[0-9A-Fa-f]{2})+)\r", heard)
        if found is None:
            return None if heard else SILENT
        *data, checksum = bytes.fromhex(found[1].decode())
        if len(data) != _BLOCK_BYTES:
            return None
        span = _BLOCK_AT.to_bytes(2, "big")
        for name, head in (
            ("the data", b""),
            ("address, count and data", span + _BLOCK_BYTES.to_bytes(2, "big")),
            ("address and data", span),
        ):
            if wisco_checksum(head + bytes(data)) == checksum:
                return f"it covers {name}"
        return "it is none that is known"

    return _judged("ree-checksum", agreed(ask), "it covers the data")


# --- what it takes, and what it refuses ---


def _cheap_frames(talk: Talk) -> Finding:
    if talk.protocol is LineProtocol.WISCO:
        reads = _hex_reads(talk)
        for name, cheap in reads.items():
            # A reply in another form has a finding of its own: here it counts as one.
            said = agreed(lambda cheap=cheap: talk.answer(cheap, protected=False) or "read")  # type: ignore[misc]
            if said != "read":
                return differs("cheap-frames", f"{name}: {_told(said)}")
        return as_assumed("cheap-frames", " and ".join(reads))
    request = talk.modbus(ReadHoldingRegisters(0, 1 + talk.model.outputs))
    said = agreed(lambda: talk.answer(request, protected=True))
    if said != "read":
        return differs("cheap-frames", f"all registers in one read: {_told(said)}")
    return as_assumed("cheap-frames", "all registers in one read")


def _hex_reads(talk: Talk) -> dict[str, Request[int]]:
    reads: dict[str, Request[int]] = {"RDOH": ReadOutputsHex(talk.address, talk.model)}
    if talk.model.inputs:
        reads["RDIH"] = ReadInputsHex(talk.address)
    return reads


def _fc02_on_do100(talk: Talk) -> Finding:
    if talk.model is DIO100:
        return not_tried("fc02-on-do100", "a DIO100 has inputs")
    reads: list[tuple[str, Callable[[], str | None]]] = []
    if talk.is_text:
        inputs = ReadInputsHex(talk.address)
        reads.append(("RDIH", lambda: talk.answer(inputs, protected=False)))
    if talk.takes_modbus:
        request = talk.modbus(ReadDiscreteInputs(0, DIO100.inputs))
        reads.append(("function 02", lambda: talk.answer(request, protected=True)))
    return _refusals("fc02-on-do100", reads, "code 1")


def _exceptions(talk: Talk) -> Finding:
    reads: list[tuple[str, Callable[[], str | None]]] = []
    if talk.is_text:
        reads.append(("REE past the end", lambda: _wisco_code(talk)))
    if talk.takes_modbus:
        request = talk.modbus(ReadCoils(_OUTSIDE, 1))
        reads.append(("a coil that is not there", lambda: talk.answer(request, protected=True)))
    return _refusals("exceptions", reads, "code 2")


def _wisco_code(talk: Talk) -> str | None:
    heard = talk.wisco(_PAST_THE_END)
    found = re.search(rb"ERR=([0-9])", heard)
    if found:
        return f"code {int(found[1])}"
    return None if heard else SILENT


def _refusals(name: str, reads: list[tuple[str, Callable[[], str | None]]], wanted: str) -> Finding:
    said = {what: agreed(ask) for what, ask in reads}
    # Frames that it does not take at all are a finding of `switch-8`.
    heard = {what: one for what, one in said.items() if one != SILENT}
    if wrong := {what: one for what, one in heard.items() if one not in (wanted, None)}:
        return differs(name, "; ".join(f"{what}: {_told(one)}" for what, one in wrong.items()))
    if wanted in heard.values():
        return as_assumed(name, f"{wanted} ({', '.join(heard)})")
    if set(said.values()) == {SILENT} and name == "fc02-on-do100":
        return differs(name, "no answer")
    return not_tried(name, _NO_ANSWER)


def _switch_8(talk: Talk) -> Finding:
    if not talk.is_text:
        return not_tried("switch-8", "switch 8 is OFF: Modbus RTU")
    if not talk.takes_modbus:
        return not_tried("switch-8", ASSUMPTIONS["station-0"].untried)
    wisco = agreed(lambda: "heard" if talk.wisco("RDO") else SILENT)
    ascii_ = agreed(lambda: "heard" if talk.ascii(ReadCoils(0, 1)) else SILENT)
    if wisco == ascii_ == "heard":
        return as_assumed("switch-8", "both are answered")
    takes = "Wisco" if wisco == "heard" else "Modbus ASCII"
    return differs("switch-8", f"{takes} frames alone are answered")


def _register_bytes(talk: Talk) -> Finding:
    if not talk.is_text or not talk.takes_modbus:
        return not_tried("register-bytes", "it takes both Wisco and Modbus frames to see")
    request = ModbusDriver(talk.address, talk.model, LineProtocol.MODBUS_ASCII).read_settings
    block = _SHORT_BLOCK if talk.line.quieter(0.0) is None else READ_BLOCK_BYTES
    for _ in range(3):
        try:
            settings = talk.line.exchange(request, protected=True)
            data = Eeprom(talk.line, talk.address, block).read(lambda *_: None)
        except ExchangeError:
            continue
        return as_assumed("register-bytes", _where(settings.hold_ds, data))
    return not_tried("register-bytes", "registers or EEPROM could not be read")


def _where(hold_ds: tuple[int, ...], data: bytes) -> str:
    orders: tuple[tuple[str, int, bytes], ...] = (
        ("high byte first", 2, b"".join(value.to_bytes(2, "big") for value in hold_ds)),
        ("low byte first", 2, b"".join(value.to_bytes(2, "little") for value in hold_ds)),
        ("one byte each", 1, bytes(value & 0xFF for value in hold_ds)),
    )
    for words, size, pattern in orders:
        at = data.find(pattern)
        if at >= 0:
            return f"the hold times lie at {at:04X}h, {words}; the mode {size} before"
    return "the hold times are nowhere to be found in the EEPROM"


# --- helpers ---


def _judged(name: str, said: str | None, wanted: str) -> Finding:
    if said is None or said == SILENT:
        return not_tried(name, _NO_ANSWER)
    return as_assumed(name, said) if said == wanted else differs(name, said)


def _told(said: str | None) -> str:
    if said == "read":
        return "it is answered"
    return said or "no answer that can be read"


QUESTIONS: dict[str, Callable[[Talk], Finding]] = {
    "err-end": _err_end,
    "line-end": _line_end,
    "hex-case": _hex_case,
    "cheap-frames": _cheap_frames,
    "ree-checksum": _ree_checksum,
    "register-bytes": _register_bytes,
    "fc02-on-do100": _fc02_on_do100,
    "exceptions": _exceptions,
    "switch-8": _switch_8,
}
