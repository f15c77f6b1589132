import random
from functools import partial

import pytest
from support.virtual_worker import VirtualWorker, make_line, make_station

from bridge.config.schema import LineConfig
from bridge.line.forecast import forecast
from bridge.line.promptness import LinePromptness
from bridge.model import DO100, LineProtocol, Status, ValuesChanged, Verdict, Writes

pytestmark = pytest.mark.warns  # modules that die are logged

WAYS = [
    (LineProtocol.WISCO, Writes.AUTO, 57600),
    (LineProtocol.WISCO, Writes.AUTO, 9600),
    (LineProtocol.WISCO, Writes.WISCO, 19200),
    (LineProtocol.MODBUS_RTU, Writes.AUTO, 57600),
    (LineProtocol.MODBUS_ASCII, Writes.AUTO, 9600),
]
T = 118.0
DIED_AT = 103.0
STATIONS = 8


def prompt(line: LineConfig) -> LinePromptness:
    """What `check` says of it."""
    return LinePromptness(line, forecast(line))


@pytest.mark.unmeasured  # long in virtual time: shorter tests cover the lines
@pytest.mark.parametrize("dead", [0, 2, STATIONS - 1])
@pytest.mark.parametrize(("protocol", "writes", "baud"), WAYS)
def test_all_is_seen_and_done_within_what_check_says(
    protocol: LineProtocol, writes: Writes, baud: int, dead: int
) -> None:
    """At any instant: an input, a foreign switch, a command and a scene; also with dead modules."""
    line = make_line(
        *(make_station(n) for n in range(1, STATIONS + 1)),
        protocol=protocol,
        writes=writes,
        baud=baud,
    )
    worker, chance = VirtualWorker(line), random.Random(dead)  # noqa: S311
    module = worker.line.modules[1]
    for address in range(2, 2 + dead):
        worker.line.at(DIED_AT, partial(setattr, worker.line.modules[address], "away", True))
    said = prompt(line).with_dead() if dead else prompt(line).stations()["s1"]
    instants = [T + 8 * n + chance.random() for n in range(3)]
    for n, at in enumerate(instants):
        worker.line.at(at, partial(module.set_input, 1, n % 2 == 0))
        worker.line.at(at + 2, partial(module.set_output, 8, n % 2 == 0))
        worker.command_at(at + 5, 1, n % 2 == 0, command_id=f"command {n}")
        for output in range(1, 8):
            worker.command_at(at + 6, 1 << output, (n % 2 == 0) << output, command_id="scene")
    worker.run(instants[-1] + 10)
    changes = [at for at, event in worker.events if isinstance(event, ValuesChanged)]
    verdicts = [(at, event) for at, event in worker.events if isinstance(event, Verdict)]
    assert all(verdict.status is Status.DONE for _, verdict in verdicts)
    assert said.input_s is not None
    for n, at in enumerate(instants):
        assert any(at < seen <= at + said.input_s + 1e-6 for seen in changes)
        assert any(at + 2 < seen <= at + 2 + said.output_s + 1e-6 for seen in changes)
        (done,) = [done for done, verdict in verdicts if verdict.id == f"command {n}"]
        assert done <= at + 5 + said.command_s + 1e-6
        scene = [done for done, v in verdicts if v.id == "scene" and at + 6 <= done < at + 8]
        assert len(scene) == 7
        assert max(scene) <= at + 6 + said.scene_s + 1e-6


def test_a_module_without_inputs_has_no_time_for_them() -> None:
    """A line of DO100s alone tells of outputs only, with dead modules too."""
    said = prompt(make_line(make_station(1, DO100), make_station(2, DO100)))
    assert said.stations()["s1"].input_s is None
    assert said.with_dead().input_s is None


def test_a_scene_longer_than_a_burst_leaves_half_of_the_time_to_reads() -> None:
    """What takes 2.5 s of writing takes half a second more."""
    short, long = (make_line(*(make_station(n) for n in range(1, 1 + k))) for k in (10, 30))
    assert prompt(short).scene_s() < 2.0
    assert prompt(long).scene_s() > 3 * prompt(short).scene_s()
