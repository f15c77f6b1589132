"""The keys `max_on` and `on_loss`: they switch an output without a command."""

from collections.abc import Iterable, Mapping, Sequence

from bridge.config.durations import duration
from bridge.config.nodes import Place
from bridge.config.scalars import choice
from bridge.config.schema import OnLossConfig, OutputConfig
from bridge.config.tables import Table, table_of
from bridge.model import bit, channels_of

max_on = duration("1s", "1440min")
# After this time no earlier command is still valid: it would undo this (docs/contract.md, promise
# 2).
_after = duration("2s", "1440min")
_STATES: Mapping[str, bool] = {"ON": True, "OFF": False}


def read_on_loss(place: Place) -> OnLossConfig:
    """Read `on_loss`."""
    with table_of(place) as table:
        after_s = table.need("after", _after, "write how long the broker is away by then, as 30s")
        on = table.need("state", choice(_STATES), "write ON or OFF")
    if after_s is None or on is None:
        # The problem is reported: this placeholder switches nothing.
        return OnLossConfig(after_s=float("inf"), on=False)
    return OnLossConfig(after_s, on)


def check_fail_safe(table: Table, output: OutputConfig) -> None:
    """Report `max_on` and `on_loss` at an output that is a pulse or `read_only`."""
    for key in ("max_on", "on_loss"):
        if key not in table:
            continue
        if output.mode == "pulse":
            table.problem(
                key, "cannot stand beside mode: pulse, which ends by itself; take one of them out"
            )
        if output.read_only:
            table.problem(key, "cannot stand beside read_only: true; take one of the two out")


def check_on_loss_together(
    table: Table, outputs: Iterable[OutputConfig], groups: Sequence[int]
) -> None:
    """Report a group of interlocked outputs of which more than one has `on_loss` ON."""
    going_on = sum(bit(o.channel) for o in outputs if o.on_loss is not None and o.on_loss.on)
    for group in groups:
        if (group & going_on).bit_count() > 1:
            these = " and ".join(map(str, channels_of(group & going_on)))
            table.problem(
                "interlock",
                f"outputs {these} are interlocked, and on_loss would have them ON together; "
                "write OFF for all but one",
            )
