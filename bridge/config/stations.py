"""One station: an entry below `stations`."""

from collections.abc import Mapping
from dataclasses import dataclass

from bridge.config.channels import inputs_of, outputs_of
from bridge.config.covers import check_dead_time, covers_of, with_latches
from bridge.config.durations import duration
from bridge.config.fail_safe import check_on_loss_together
from bridge.config.interlock import interlock_of
from bridge.config.names import MAX_ID_CHARACTERS, folded, identifier, is_id
from bridge.config.nodes import Place
from bridge.config.scalars import choice, positive_number, whole
from bridge.config.schema import StationConfig
from bridge.config.tables import Table, Unique, table_of
from bridge.config.text import label
from bridge.model import LAST_ADDRESS, MODULE_TYPES, ModuleType

MAX_COMMANDS_A_SECOND = 1000

_PRIORITIES: Mapping[str, bool] = {"high": True, "normal": False}

# A placeholder for a wrong model, so that the problems of the channels are still reported.
_ANY_MODEL = ModuleType("module", inputs=16, outputs=16)
_DEFAULT = StationConfig(0, _ANY_MODEL, "", "", inputs=(), outputs=())


@dataclass(frozen=True, slots=True)
class LineFacts:
    """The line as a station needs to know it. `id` is None if it is wrong."""

    id: str | None
    zero_is_a_station: bool
    addresses: Unique
    station_ids: Unique


def read_station(place: Place, line: LineFacts) -> StationConfig | None:
    """Read one station; None: it has a problem."""
    with table_of(place) as table:
        address = _read_address(table, line)
        model = table.need("model", choice(MODULE_TYPES), "write DIO100 or DO100")
        station_id = _read_id(table, line, address)
        name = table.get("name", label, station_id)
        area = table.get("area", label, None)
        high_priority = table.get("priority", choice(_PRIORITIES), _DEFAULT.high_priority)
        rate_limit = table.get(
            "rate_limit", positive_number(MAX_COMMANDS_A_SECOND), _DEFAULT.rate_limit
        )
        inputs = table.section("inputs", inputs_of(model or _ANY_MODEL))
        outputs = table.section("outputs", outputs_of(model or _ANY_MODEL))
        interlock = table.get("interlock", interlock_of(model or _ANY_MODEL, outputs), ())
        dead_s = table.get("interlock_dead_time", duration("0ms", "60s"), _DEFAULT.interlock_dead_s)
        check_on_loss_together(table, outputs, interlock)
        covers = table.section("covers", covers_of(model or _ANY_MODEL, outputs, interlock))
        check_dead_time(table, covers, dead_s)
    if address is None or model is None or station_id is None or name is None:
        return None
    return StationConfig(
        address=address,
        model=model,
        id=station_id,
        name=name,
        inputs=inputs,
        outputs=with_latches(outputs, covers),
        area=area,
        high_priority=high_priority,
        rate_limit=rate_limit,
        interlock=(*interlock, *(cover.outputs for cover in covers)),
        interlock_dead_s=dead_s,
        covers=covers,
    )


def _read_address(table: Table, line: LineFacts) -> int | None:
    advice = f"write the number on DIP switches 1-5, 0 to {LAST_ADDRESS}"
    address = table.need("address", whole(0, LAST_ADDRESS), advice)
    if address is None:
        return None
    line.addresses.claim(address, table.place("address"), f"address {address}")
    if address == 0 and not line.zero_is_a_station:
        # docs/failures.md A9: in Modbus address 0 is the broadcast, which every module obeys.
        table.problem(
            "address", "0 is every module at once in Modbus; write 1 to 31 and set the DIP switch"
        )
    return address


def _read_id(table: Table, line: LineFacts, address: int | None) -> str | None:
    station_id = table.get("id", identifier, None)
    if "id" not in table and line.id is not None and address is not None:
        station_id = _default_id(table, line.id, address)
    if station_id is not None:
        line.station_ids.claim(folded(station_id), table.place("id"), f"id {station_id}")
    return station_id


def _default_id(table: Table, line: str, address: int) -> str | None:
    station_id = f"{line}_{address:02}"
    if is_id(station_id):
        return station_id
    table.problem(
        "id",
        f"id is missing, and the default {station_id} has over {MAX_ID_CHARACTERS} characters; "
        "write a shorter one",
    )
    return None
