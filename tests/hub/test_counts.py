from dataclasses import replace

import pytest
from support.house import GARAGE, make_config

from bridge.config.current import CurrentConfig
from bridge.config.schema import Config, CountConfig, InputConfig
from bridge.hub.counts import Counts
from bridge.model import CountChanged, PublicEvent

METER = ("garage", 3)
BELL = ("garage", 5)


def config_with(*channels: int) -> Config:
    """A house in which these inputs of the garage are counted."""
    inputs = tuple(
        InputConfig(n, count=CountConfig() if n in channels else None) for n in range(1, 17)
    )
    return make_config(stations=(replace(GARAGE, inputs=inputs),))


class CountedInputs:
    """Counts of two inputs, and what was published of them."""

    def __init__(self, *channels: int) -> None:
        self.told: list[tuple[str, int, int]] = []
        self.current = CurrentConfig(config_with(*(channels or (3, 5))))
        self.counts = Counts(self.current, self._publish)

    def _publish(self, event: PublicEvent) -> None:
        assert isinstance(event, CountChanged)
        self.told.append((event.station_id, event.channel, event.edges))

    def reload(self, *channels: int) -> None:
        """From now on these inputs are counted."""
        self.current.replace(config_with(*channels))
        self.counts.publish_all()

    def rise(self, *channels: int, times: int = 1) -> None:
        """These inputs go ON."""
        for _ in range(times):
            self.counts.rose("garage", sum(1 << (channel - 1) for channel in channels))

    def latest(self) -> dict[tuple[str, int], int]:
        """What the broker holds, then."""
        return {(station_id, channel): edges for station_id, channel, edges in self.told}


def test_each_edge_is_published_with_the_new_count() -> None:
    """Several inputs at once, one message each."""
    world = CountedInputs()
    world.counts.found({})
    world.told.clear()
    world.rise(3)
    world.rise(3, 5)
    assert world.told == [("garage", 3, 1), ("garage", 3, 2), ("garage", 5, 1)]


@pytest.mark.parametrize(
    ("kept", "retained"),
    [(10, {METER: 7}), (7, {METER: 10}), (10, {METER: 10}), (10, {})],
)
def test_the_larger_of_file_and_broker_holds(
    kept: int, retained: dict[tuple[str, int], int]
) -> None:
    """Before the broker is asked nothing is published; the edges since the start are added."""
    world = CountedInputs()
    world.counts.restore({METER: kept})
    world.rise(3, times=3)
    assert world.told == []
    world.counts.found(retained)
    assert world.latest() == {METER: 13, BELL: 0}


def test_what_the_broker_holds_later_is_our_own() -> None:
    """Only the first look of a run tells of an earlier one."""
    world = CountedInputs()
    world.counts.found({METER: 5})
    world.counts.found({METER: 1000})
    world.rise(3)
    assert world.latest()[METER] == 6


def test_a_count_taken_from_the_broker_is_a_change_for_the_file() -> None:
    """The broker may forget it: the file has it from then on."""
    world = CountedInputs()
    world.counts.restore({METER: 5})
    assert world.counts.changes == 0
    world.counts.found({METER: 9})
    assert world.counts.changes == 1
    assert world.counts.kept() == {METER: 9}


def test_what_is_not_counted_any_more_is_kept() -> None:
    """Counted again, it goes on: a slip in the configuration costs no count."""
    world = CountedInputs()
    world.counts.found({METER: 5, BELL: 2})
    world.rise(3)
    world.reload(5)
    assert world.counts.kept() == {METER: 6, BELL: 2}
    world.told.clear()
    world.reload(3, 5)
    assert world.latest() == {METER: 6, BELL: 2}


def test_an_input_that_is_counted_from_now_on_begins_at_0() -> None:
    """It is published at once: the entity has a value before the first edge."""
    world = CountedInputs(3)
    world.counts.found({})
    world.told.clear()
    world.reload(3, 5)
    assert world.latest()[BELL] == 0


def test_nothing_is_counted_where_nothing_is_configured() -> None:
    """Then there is no need of a file."""
    current = CurrentConfig(config_with())
    counts = Counts(current, lambda *_: None)
    assert not counts.any
    current.replace(config_with(3))
    assert counts.any
