from dataclasses import replace

from support.fake_worker import FakeWorker, fake_workers

from bridge.config.schema import LineConfig
from bridge.hub.line_set import LineSet
from bridge.model import LeftCover, LineProtocol, StandingCover

FRONT = LineConfig("front", "/dev/null", 9600, LineProtocol.WISCO, stations=())
BACK = replace(FRONT, id="back")
FASTER = replace(BACK, baud=57600)


class StartedLines:
    """A set of lines, and every worker that it ever made."""

    def __init__(self, *lines: LineConfig) -> None:
        self.made, make = fake_workers()
        self.lines = LineSet(make)
        self.lines.start(lines)


def test_every_worker_hears_once_when_the_broker_goes_and_comes() -> None:
    """Every worker is told once that the broker went or came, also one that starts meanwhile."""
    world = StartedLines(FRONT, BACK)
    for away, now in ((True, 5.0), (True, 6.0)):
        world.lines.broker(away=away, now=now)
    world.lines.replace([FRONT, FASTER])
    world.made[1].alive = False
    world.lines.renew()
    for away, now in ((False, 9.0), (False, 9.5), (True, 20.0)):
        world.lines.broker(away=away, now=now)
    assert [worker.away_since for worker in world.made] == [
        [None, 5.0, None, 20.0],
        [None, 5.0],
        [5.0, None, 20.0],
    ]


def test_what_is_the_same_is_not_touched() -> None:
    """An equal line keeps its worker."""
    world = StartedLines(FRONT, BACK)
    world.lines.replace([replace(BACK), replace(FRONT)])
    assert (world.lines.leaving, world.lines.coming) == ([], [])
    assert world.lines.all_left
    world.lines.renew()
    assert [worker.stops for worker in world.made] == [0, 0]


def test_a_changed_line_is_exchanged_when_its_worker_has_ended() -> None:
    """A changed line takes no commands from the request to end until its new worker runs."""
    world = StartedLines(FRONT, BACK)
    world.lines.replace([FRONT, FASTER])
    assert list(world.lines.workers) == ["front"]
    assert (world.lines.leaving, world.lines.coming) == ([BACK], [FASTER])
    assert not world.lines.all_left
    assert [worker.stops for worker in world.made] == [0, 1]
    assert len(world.made) == 2
    world.made[1].alive = False
    assert world.lines.all_left
    world.lines.renew()
    assert {name: w.config for name, w in world.lines.workers.items()} == {
        "front": FRONT,
        "back": FASTER,
    }
    assert world.made[2].alive
    assert (world.lines.leaving, world.lines.coming) == ([], [])


def test_lines_that_come_and_go() -> None:
    """A new line is started, and a removed line ends."""
    world = StartedLines(FRONT)
    world.lines.replace([BACK])
    world.made[0].alive = False
    world.lines.renew()
    assert list(world.lines.workers) == ["back"]


def test_who_died_is_named() -> None:
    """With the cause where there is one; who was asked to end has not died."""
    world = StartedLines(FRONT, BACK)
    assert world.lines.failure(stuck_before=5.0) is None
    world.lines.replace([FRONT])
    world.made[1].alive = False
    assert world.lines.failure(stuck_before=5.0) is None
    world.made[0].alive = False
    assert world.lines.failure(stuck_before=5.0) == "the thread of line front ended"
    world.made[0].failure = "line front: ZeroDivisionError"
    assert world.lines.failure(stuck_before=5.0) == "line front: ZeroDivisionError"


def test_who_is_stuck_is_named_also_when_it_should_end() -> None:
    """A worker that never ends would hold up a reload for ever."""
    world = StartedLines(FRONT, BACK)
    assert world.lines.failure(stuck_before=10.0) is None
    world.lines.replace([FRONT])
    world.made[1].progress = 9.9
    assert world.lines.failure(stuck_before=10.0) == "the thread of line back is stuck"


def test_at_the_end_everybody_is_asked_to_end() -> None:
    """At the end all workers are asked to end, also one that is being exchanged."""
    world = StartedLines(FRONT, BACK)
    world.lines.replace([FRONT, FASTER])
    world.lines.stop()
    assert [worker.stops for worker in world.made] == [1, 1]
    assert not world.lines.all_left
    for worker in world.made:
        worker.alive = False
    assert world.lines.all_left


def _left(worker: FakeWorker) -> LeftCover:
    return LeftCover(1, f"{worker.config.id}1", "gate")


def test_the_covers_that_a_line_left_or_still_stops_are_told_by_line() -> None:
    """Left covers are reported by line, without those of lines that continue."""
    world = StartedLines(FRONT, BACK)
    for worker in world.made:
        worker.moving = (_left(worker),)
    world.lines.replace([FRONT])
    assert world.lines.moving(alive=True) == ["line back station 1 (back1): cover gate"]
    assert world.lines.moving(alive=False) == []
    world.made[1].alive = False
    assert world.lines.moving(alive=True) == []
    assert world.lines.moving(alive=False) == ["line back station 1 (back1): cover gate"]


def test_who_follows_takes_over_the_covers() -> None:
    """Motors that could not be stopped, and where covers stand: a reload moves none."""
    world = StartedLines(FRONT, BACK)
    world.made[1].moving = left = (_left(world.made[1]),)
    known = StandingCover(1, "back1", "gate", "1 20.0, 2 20.0", 40.0)
    world.lines.replace([FRONT, FASTER])
    world.made[1].standing, world.made[1].alive = (known,), False
    assert world.lines.standing_covers == (known,)
    world.lines.renew()
    assert set(world.made[2].inherited) == {*left, known}
    assert world.made[0].inherited == []
