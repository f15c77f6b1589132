"""`config_version`: for which meaning of the keys a file was written.

A key that changes its meaning gets the next version and an entry in `_CHANGED`. Its value is
carried over, and files of an earlier version are warned of it for a year after the release.
"""

from collections.abc import Callable, Collection, Iterator, Mapping

from bridge.config.nodes import Place, WrongValueError
from bridge.config.scalars import whole
from bridge.config.schema import (
    CURRENT_VERSION,
    OLDEST_VERSION,
    USUAL_RATE_LIMIT,
    Config,
    StationConfig,
)
from bridge.config.shapes import shaped

_any_version = whole(OLDEST_VERSION, 1_000_000)


def version(place: Place) -> int:
    """Read the version of a file that this release understands."""
    written = _any_version(place)
    if written > CURRENT_VERSION:
        raise WrongValueError(
            f"{written} is of a later wisco2mqtt; this one knows versions up to {CURRENT_VERSION}: "
            "install the later one, or restore the file that you had with this one"
        )
    return written


shaped(version, {"type": "integer", "minimum": OLDEST_VERSION, "maximum": CURRENT_VERSION})


def changed_keys(config: Config) -> Iterator[str]:
    """Yield one line for each key that meant something else in the version of the file."""
    for since, (is_used, change) in _CHANGED.items():
        stations = [station.id for _, station in config.all_stations if is_used(station)]
        if config.version < since and stations:
            yield (
                f"{_some(stations)}: {change}; the value is used as it is. Where that is right, "
                f"write config_version: {CURRENT_VERSION} at the top of the file"
            )


def _some(stations: Collection[str]) -> str:
    first = sorted(stations)[:3]
    more = len(stations) - len(first)
    return f"station {', '.join(first)}" + (f" and {more} more" if more else "")


def _limits(config: StationConfig) -> bool:
    return config.rate_limit != USUAL_RATE_LIMIT


_RATE_LIMIT = (
    "rate_limit limits pulses, TOGGLE and settings alone now; commands that say ON or OFF to "
    "latches are all taken, and of those that wait only the newest is carried out"
)

# By the version since which a key means something else: which stations use it, and what it means.
_CHANGED: Mapping[int, tuple[Callable[[StationConfig], bool], str]] = {2: (_limits, _RATE_LIMIT)}
