from collections.abc import Callable

import pytest
from support.commands import make_command

from bridge.line.inbox import BURST_S, TimeShare, WaitingCommands
from bridge.model import AnyCommand, Command, Setting, SettingCommand, Word

PULSES = 0b1000_0000


class Queue:
    """Waiting commands of stations whose output 8 is a pulse."""

    def __init__(self, may_stall: Callable[[AnyCommand], bool] = lambda _: False) -> None:
        self.overtaken: list[AnyCommand] = []
        self.commands = WaitingCommands(
            lambda command: (
                isinstance(command, Command) and command.word is None and not command.mask & PULSES
            ),
            self.overtaken.append,
            may_stall,
        )

    def put(self, *commands: AnyCommand) -> None:
        """Puts commands in and has them collected."""
        for command in commands:
            self.commands.put(command)
        self.commands.collect()

    def take_all(self) -> list[AnyCommand]:
        """Everything that waits, in the order in which it would be carried out."""
        return [self.commands.pop() for _ in range(len(self.commands))]


def test_commands_come_out_in_the_order_in_which_they_came_in() -> None:
    """First in, first out; nothing shows before it is collected."""
    queue = Queue()
    first, second = make_command(1, 1), make_command(2, 2)
    queue.commands.put(first)
    assert len(queue.commands) == 0
    queue.put(second)
    assert queue.take_all() == [first, second]


def test_a_flooded_station_lets_another_pass_after_four_in_a_row() -> None:
    """docs/failures.md A15: others do not wait for all that one station was told to do."""
    queue = Queue()
    flood = [make_command(1, word=Word.TOGGLE) for _ in range(10)]
    others = [make_command(bit, bit, station_id="pumps") for bit in (1, 2)]
    queue.put(*flood, *others)
    assert queue.take_all() == [*flood[:4], others[0], *flood[4:8], others[1], *flood[8:]]


def test_a_scene_of_few_commands_keeps_its_order_over_stations() -> None:
    """Up to four in a row for one station, nobody is let pass."""
    queue = Queue()
    scene = [
        *[make_command(1 << n, 0) for n in range(4)],
        make_command(1, 1, station_id="pumps"),
        make_command(1 << 4, 0),
    ]
    queue.put(*scene)
    assert queue.take_all() == scene


def test_a_newer_command_for_the_same_outputs_overtakes_the_older() -> None:
    """Only the last wish for a latch is worth sending; the older is handed back once."""
    queue = Queue()
    on, off, both = make_command(1, 1), make_command(1, 0), make_command(3, 3)
    queue.put(on, off)
    assert queue.overtaken == [on]
    queue.put(both)
    assert queue.overtaken == [on, off]
    assert queue.take_all() == [both]


def test_a_command_that_names_more_outputs_is_not_overtaken() -> None:
    """Part of it is still wanted."""
    queue = Queue()
    both, one = make_command(3, 3), make_command(1, 0)
    queue.put(both, one)
    assert queue.take_all() == [both, one]


def test_several_newer_commands_overtake_one_that_names_their_outputs() -> None:
    """Of each of its outputs something newer is said: nothing of it is wanted any more."""
    queue = Queue()
    both, one, other = make_command(3, 3), make_command(1, 0), make_command(2, 2)
    queue.put(both, one)
    assert queue.overtaken == []
    queue.put(other)
    assert queue.overtaken == [both]
    assert queue.take_all() == [one, other]


def test_a_flood_of_words_for_latches_waits_in_bounded_memory() -> None:
    """Of each output the newest is kept: 16 at the most, however the masks overlap."""
    queue = Queue()
    for n in range(2000):
        mask = n * 7919 % 127 + 1
        queue.put(make_command(mask, mask & n))
        assert len(queue.commands) <= 16


def test_another_station_overtakes_nothing() -> None:
    """The same output of another module is another output."""
    queue = Queue()
    here, there = make_command(1, 1), make_command(1, 0, station_id="cellar")
    queue.put(here, there)
    assert queue.take_all() == [here, there]


@pytest.mark.parametrize(
    "special",
    [make_command(1, 0, word=Word.TOGGLE), make_command(PULSES, PULSES, word=Word.PRESS)],
)
def test_a_toggle_or_pulse_neither_overtakes_nor_is_overtaken(special: Command) -> None:
    """Each means something of its own."""
    queue = Queue()
    before, after = make_command(special.mask, 0), make_command(special.mask, special.mask)
    queue.put(before, special, special, after)
    assert queue.overtaken == []
    assert queue.take_all() == [before, special, special, after]


def test_what_a_toggle_builds_upon_is_not_overtaken_across_it() -> None:
    """ON, TOGGLE, OFF: without the ON the toggle would switch the relay on."""
    queue = Queue()
    on, toggle, off = make_command(1, 1), make_command(1, 0, word=Word.TOGGLE), make_command(1, 0)
    queue.put(on, toggle, off)
    assert queue.take_all() == [on, toggle, off]


def test_a_toggle_of_another_output_is_no_obstacle() -> None:
    """Only what concerns the same outputs matters."""
    queue = Queue()
    on, toggle, off = make_command(1, 1), make_command(2, 0, word=Word.TOGGLE), make_command(1, 0)
    queue.put(on, toggle, off)
    assert queue.take_all() == [toggle, off]


def test_commands_for_a_module_that_does_not_answer_stand_back() -> None:
    """A command never waits for a dead module (promise 7), yet those are not forgotten."""
    queue = Queue(may_stall=lambda command: command.station_id == "dying")
    slow, slower = make_command(1, 1, station_id="dying"), make_command(2, 2, station_id="dying")
    quick = make_command(1, 1)
    queue.put(slow, slower, quick)
    assert queue.take_all() == [quick, slow, slower]


def test_a_newer_command_for_an_output_is_seen_before_it_is_collected() -> None:
    """A latch write is not repeated when a newer command for that output waits."""
    queue = Queue()
    command = make_command(3, 3)
    assert not queue.commands.newer_than(command)
    queue.commands.put(make_command(4, 4))
    queue.commands.put(make_command(3, 0, station_id="cellar"))
    assert not queue.commands.newer_than(command)
    queue.commands.put(make_command(2, 0))
    assert queue.commands.newer_than(command)


def test_a_stop_ends_a_wait_and_is_remembered() -> None:
    """Sleep, wake-up and stop are one: no stop is missed, and what waits still waits."""
    queue = Queue()
    queue.commands.put(make_command(1, 1))
    queue.commands.stop(100.0)
    queue.commands.collect(wait_s=30.0)
    assert queue.commands.stopping
    assert queue.commands.stop_asked_at == 100.0
    assert len(queue.commands) == 1


def test_a_wait_ends_with_nothing_when_nothing_comes() -> None:
    """The wait is bounded."""
    queue = Queue()
    queue.commands.collect(wait_s=0.001)
    assert len(queue.commands) == 0


def test_commands_may_take_two_seconds_at_once_and_half_of_the_time_in_the_end() -> None:
    """A scene is carried out in one go, and a flood leaves the line to the reads by turns."""
    share, now, commands_s, reads_s = TimeShare(0.0), 0.0, 0.0, 0.0
    bursts = []
    while now < 60.0:
        share.begin(now)
        begun = now
        while share.is_left(now):
            now += 0.06
        share.end(now)
        bursts.append(now - begun)
        commands_s += now - begun
        now += 0.03
        reads_s += 0.03
    assert BURST_S <= bursts[0] <= BURST_S + 0.06
    assert max(bursts[1:]) <= 0.13
    assert reads_s == pytest.approx(commands_s - BURST_S, abs=0.1)


def test_a_quiet_time_earns_one_burst_and_no_more() -> None:
    """After an hour without commands the reads are not shut out for half an hour."""
    share = TimeShare(0.0)
    share.begin(3600.0)
    assert share.is_left(3600.0 + BURST_S - 0.01)
    assert not share.is_left(3600.0 + BURST_S)
    share.end(3600.0 + 10.0)
    share.begin(3610.0)
    assert not share.is_left(3610.0)
    share.fill()
    assert share.is_left(3610.0)


def test_a_suspend_of_the_machine_is_no_command() -> None:
    """The clock goes on meanwhile: commands are not held back for as long afterwards."""
    share = TimeShare(0.0)
    share.begin(1.0)
    share.end(111.0)
    share.begin(111.0 + BURST_S + 0.1)
    assert share.is_left(111.0 + BURST_S + 0.1)


def test_there_is_time_for_one_urgent_command_in_any_case() -> None:
    """After a burst an urgent command begins, and one alone, until the next read."""
    share = TimeShare(0.0)
    share.begin(0.0)
    share.end(4.0)
    share.begin(4.05, urgent=True)
    assert share.is_left(4.05)
    assert not share.is_left(4.10)


@pytest.mark.parametrize(("now", "urgent"), [(0.4, False), (0.6, True)])
def test_a_value_is_urgent_after_a_quarter_of_its_time(now: float, urgent: bool) -> None:
    """A command that arrived at 0 s and expires at 2 s."""
    queue = Queue()
    queue.put(make_command(1, 1))
    assert queue.commands.is_urgent(now) is urgent


def test_no_toggle_is_urgent() -> None:
    """A flood of toggles leaves half of the line to the reads."""
    queue = Queue()
    queue.put(make_command(1, word=Word.TOGGLE))
    assert not queue.commands.is_urgent(1.9)


def make_setting(value: int, setting: Setting = Setting.HOLD, output: int = 1) -> SettingCommand:
    """A command to set something of an output of `garage`."""
    target = f"do/{output}/{setting}"
    return SettingCommand(
        "garage", target, value, output, setting, value, arrived=0.0, deadline=2.0
    )


def test_a_newer_value_of_a_setting_overtakes_those_that_wait() -> None:
    """A slider that is drawn writes the EEPROM once; other settings and outputs are left alone."""
    queue = Queue()
    mode, other = make_setting(1, Setting.MODE), make_setting(5, output=2)
    drawn = [make_setting(value) for value in (10, 20, 30)]
    queue.put(drawn[0], mode, other, *drawn[1:])
    assert queue.overtaken == drawn[:2]
    assert queue.take_all() == [mode, other, drawn[2]]


def test_settings_and_switchings_do_not_overtake_each_other() -> None:
    """A mode may be set for the sake of the command that follows, and set back after it."""
    queue = Queue()
    commands: list[AnyCommand] = [
        make_command(1, 1),
        make_setting(1, Setting.MODE),
        make_command(1, 0),
        make_setting(0, Setting.MODE),
        make_command(1, 1),
    ]
    queue.put(*commands)
    assert queue.overtaken == []
    assert queue.take_all() == commands
