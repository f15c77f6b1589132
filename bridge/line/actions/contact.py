"""The first reads of a module that was offline: its model, its values and its modes.

It only reads. Nothing is written to a module before it passed (docs/contract.md, promises 4 and 6).
"""

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol, TypeVar

from bridge.drivers.driver import Driver
from bridge.errors import BadReplyError, ExchangeError, RefusedError
from bridge.line.exchanger import Exchanger
from bridge.line.rules.tracker import BankTracker, Outcome
from bridge.line.station import Station
from bridge.model import ModuleType
from bridge.protocol.request import Request

T = TypeVar("T")

_FIRST_VALUE_READS = 6
_CONTESTED_READS = 10  # another master asks too, and its replies look like ours
_ILLEGAL_FUNCTION = 1  # docs/protocol.md sections 2 and 3: both protocols give it this code
_MODBUS_ASKS = 3  # docs/contract.md, promise 6: asked with a read, three times


class Asked(Protocol):
    """The part of a bus that single questions need."""

    def exchange(self, request: Request[T], *, protected: bool) -> T:
        """Make one exchange; see `bridge.transport.bus.Bus.exchange`."""


def make_contact(station: Station, bus: Exchanger, clock: Callable[[], float]) -> str | None:
    """Read values and settings into `station`.

    Returns:
        None if it is what the configuration says, else the complaint, in words.

    Raises:
        ExchangeError: It did not answer correctly: it is absent, or not ready yet.
        PortError: The port is gone.
    """
    if station.knocker is not None:
        _knock(station.knocker, bus)
        station.presence.noticed(clock())
    contested = station.is_contested
    if contested:  # first find out whether it takes Modbus frames, whose replies carry the station
        _ask_settings(station, bus)
    complaint = wrong_model(station.config.model, station.contact_asker, bus)
    if complaint is not None:
        return complaint
    station.presence.noticed(clock())
    if not contested:
        _ask_settings(station, bus)
    if station.config.model.inputs:
        _first_value(station, bus, lambda driver: driver.read_inputs, station.inputs, clock)
    else:
        station.inputs.value = 0
    _first_value(station, bus, lambda driver: driver.read_outputs, station.outputs, clock)
    station.interlock.met(station.outputs.value or 0, clock())
    station.found(station.outputs.value or 0, clock())
    return None


def _knock(knocker: Driver, bus: Asked) -> None:
    with suppress(RefusedError):  # it is there
        bus.exchange(knocker.read_inputs, protected=True)


def wrong_model(configured: ModuleType, reader: Driver, bus: Asked) -> str | None:
    """Check the model of a module; return the complaint, or None.

    A DIO100 answers an input read, a DO100 refuses it (docs/protocol.md sections 2 and 3). A
    complaint needs two equal answers, because any module refuses a request with a flipped bit.
    """
    complaint: str | None = None
    for _ in range(2):
        complaint = _complaint(configured, reader, bus)
        if complaint is None:
            return None
    return complaint


def _complaint(configured: ModuleType, reader: Driver, bus: Asked) -> str | None:
    try:
        bus.exchange(reader.read_inputs, protected=reader.protected)
    except RefusedError as error:
        if not configured.inputs:
            return None
        if error.code != _ILLEGAL_FUNCTION:
            raise  # noise in the request: this says nothing about the model
        return (
            f"configured as {configured.name}, but it has no inputs to read ({error}; if it is "
            "one: reading cheap-frames)"
        )
    if configured.inputs:
        return None
    return (
        f"configured as {configured.name}, but it answers an input read as a DIO100 does (if it is "
        f"a {configured.name}: reading fc02-on-do100)"
    )


def _ask_settings(station: Station, bus: Exchanger) -> None:
    """Read the settings: does it take Modbus frames, and which outputs are pulses?"""
    if station.modbus is None:
        return
    for _ in range(_MODBUS_ASKS):
        try:
            settings = bus.exchange(station.modbus.read_settings, protected=True)
        except RefusedError:
            station.takes_modbus = True  # a valid Modbus refusal is a Modbus frame too
            station.refuses_settings = True
            continue  # a single one may be chance
        except ExchangeError:
            continue
        station.takes_modbus = True
        station.refuses_settings = False
        station.learn(settings)
        return


def _first_value(
    station: Station,
    bus: Exchanger,
    read: Callable[[Driver], Request[int]],
    bank: BankTracker,
    clock: Callable[[], float],
) -> None:
    for _ in range(_CONTESTED_READS if station.is_contested else _FIRST_VALUE_READS):
        asker = station.asker(bank)
        station.let_others_pass(bus)
        asked_at = clock()
        try:
            raw = bus.exchange(read(asker), protected=asker.protected)
        except BadReplyError:
            if not station.is_contested:
                raise
            continue  # it was for another master
        apart_s = station.apart_s(asker)
        outcome = bank.observe(
            raw, clock(), asked_at=asked_at, protected=asker.protected, apart_s=apart_s
        )
        if outcome is Outcome.CHANGED:
            return
        if 0.0 < apart_s < math.inf:
            bus.listen(apart_s)
    raise BadReplyError("no two replies in a row agreed", read(station.reader).frame)
