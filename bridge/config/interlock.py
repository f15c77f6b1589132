"""The interlock of a station: groups of outputs of which at most one may be ON."""

from collections.abc import Sequence

from bridge.config.nodes import Place, Reader, WrongValueError, items
from bridge.config.scalars import whole
from bridge.config.schema import OutputConfig
from bridge.config.tables import Unique
from bridge.model import ModuleType, bit


def interlock_of(model: ModuleType, outputs: Sequence[OutputConfig]) -> Reader[tuple[int, ...]]:
    """Return a reader of `interlock`: a mask for each group, bit n-1 for output n."""
    present = {output.channel for output in outputs}

    def read(place: Place) -> tuple[int, ...]:
        used = Unique()
        read = (
            group.read(lambda place: _read_group(place, model, present, used), 0)
            for group in items(place)
        )
        return tuple(group for group in read if group)

    return read


def _read_group(place: Place, model: ModuleType, present: set[int], used: Unique) -> int:
    listed = items(place)
    if len(listed) < 2:  # noqa: PLR2004  # it takes two to be ON at once
        raise WrongValueError(
            "has fewer than two outputs; write those of which never two may be ON, such as [1, 2]"
        )
    group = 0
    for item in listed:
        output = item.read(whole(1, model.outputs), None)
        if output is None:
            continue
        if output not in present:
            item.problem(f"output {output} is left out of outputs; take it out here too")
        used.claim(output, item, f"output {output}")
        group |= bit(output)
    return group
