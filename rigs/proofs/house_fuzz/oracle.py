"""Watches the wire, the modules and the broker, and says which promise was broken.

It knows nothing of the program: only frames that went out, what modules did, what the broker was
told, and the promises of the bridge. Each promise has a name, by which it can be left out.
"""

import json
import logging
import math
import re
from collections import Counter, defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from support.virtual_line import reply_of

from bridge.config.schema import Config, OutputConfig, StationConfig
from bridge.daemon.app import RunResult
from bridge.model import bits_of, channels_of
from bridge.mqtt.events import Received
from bridge.simulator.module import SimulatedModule, Switching
from proofs.house_fuzz.broker import STATE, Broker
from proofs.house_fuzz.clockwork import Clockwork
from proofs.house_fuzz.line import Line  # noqa: TC001  # as all the others
from proofs.house_fuzz.rule_watch import RuleWatch
from proofs.house_fuzz.wishes import (
    LATCH_TIMES,
    PULSE_TIMES,
    Use,
    Wish,
    key_of,
    match_all,
    read_wish,
)

PROMISES = {
    "unasked": "no relay switches without a command or a rule (4)",
    "barred": "what is retained, stored or stale never reaches the wire (2)",
    "late": "nothing is sent after its deadline (2)",
    "pulse": "a pulse is sent at most once (1)",
    "latch": "a latch is written at most twice, and not when a newer command waits (1)",
    "press": "PRESS never reaches an output that is a latch (1)",
    "read-only": "an output that is read_only is never written",
    "gap": "what lies between written outputs keeps what others switched, and its pulses",
    "refused": "of what is refused nothing went out",
    "done": "what is done was done by the module",
    "verdict": "each command gets one verdict, in time (3)",
    "state-first": "the new state is told before its verdict",
    "interlock": "interlocked outputs are never ordered ON together",
    "dead-time": "the dead time lies between two interlocked outputs",
    "motor": "a motor is switched OFF when its way is over",
    "halt": "a motor of a live module stands 3 s after a stop or a reload",
    "max-on": "max_on switches OFF in time",
    "on-loss": "on_loss acts once a loss",
    "false-state": "a state that is told was so",
    "old-state": "a state that is told is not old, or the module is offline (8)",
    "offline": "a silent module is offline within 5 s (7)",
    "order": "states are told before online",
    "log": "at most 20 lines of the log an hour for one cause (9)",
    "alive": "no thread dies or is taken to be stuck (10)",
}
STOP_S = 3.0
READ_S = 3.0  # within so long each output is read
STORY_KEPT, STORY_TOLD = 600, 25
RACE_S = 0.4  # between a read and the write that goes by it
CALM_S = 8.0
HELD_S = 58.0
CONTESTED_S = 45.0
SILENT_S = 6.5  # the 5 s of promise 7, and what the broker takes
FLOOD, FLOOD_S, FLOODED_S = 20, 8.0, 4.0
FOUND_S = 7.0  # so late a module that is back is probed
KEPT_S = 140.0  # longer than a suspend: a verdict may still come
LINES_AN_HOUR = 20
_BARRED = {"retained", "stale_link", "duplicate"}
_NUMBERS = re.compile(r"\bm?\d+(\.\d+)?\b|'[^']*'|\{.*\}")


@dataclass(frozen=True)
class Broken:
    """A promise that was not kept."""

    promise: str
    at: float
    text: str
    frames: tuple[str, ...] = ()

    def __str__(self) -> str:
        shown = "".join(f"\n      {frame}" for frame in self.frames)
        return f"{self.promise} at {self.at:.3f}: {self.text}{shown}"


@dataclass(eq=False)
class Station:
    """One module, and what is known of it."""

    line: str
    config: StationConfig
    module: SimulatedModule
    twin: SimulatedModule  # reads frames
    wishes: list[Wish] = field(default_factory=list)
    history: dict[int, deque[tuple[float, bool]]] = field(default_factory=dict)
    inputs: dict[int, deque[tuple[float, bool]]] = field(default_factory=dict)
    on_since: dict[int, float] = field(default_factory=dict)
    hand_at: dict[int, float] = field(default_factory=dict)
    mode_at: dict[int, float] = field(default_factory=dict)
    ordered_off: dict[int, float] = field(default_factory=dict)
    heard: dict[tuple[int, bool], float] = field(default_factory=dict)
    away_since: float | None = None
    back_at: float = -math.inf
    changed_at: float = 0.0
    met_at: float = math.inf  # when the bridge said that it is online; inf: it is not
    known_on: set[int] = field(default_factory=set)  # seen ON by the bridge before it went away

    @property
    def covers(self) -> int:
        """The outputs that drive motors."""
        return self.config.cover_outputs


def was(history: deque[tuple[float, bool]], value: bool, since: float, until: float) -> bool:
    """Tell whether something had a value at any instant of a time."""
    end = math.inf
    for at, then in reversed(history):
        if then is value and at <= until and end >= since:
            return True
        if end < since:
            return False
        end = at
    return False


class Oracle:
    """Judges. What it finds is in `broken`.

    Attributes:
        off: Promises that are not looked at.
    """

    def __init__(self, config: Config, broker: Broker, clockwork: Clockwork) -> None:
        self.broken: list[Broken] = []
        self.off: set[str] = set()
        self.counts: Counter[str] = Counter()
        self.lines: dict[str, Line] = {}
        self.config = config
        self.rules = RuleWatch(self, config.rules)
        self.is_down = True
        self.stations: dict[str, Station] = {}
        self._by_place: dict[tuple[str, int], Station] = {}
        self._broker = broker
        self.clockwork = clockwork
        self._orders: list[tuple[int, bool]] = []
        self._is_wisco = False
        self._trouble_at: dict[str, float] = defaultdict(lambda: -math.inf)
        self._port_at: dict[str, float] = {}
        self.ports_gone: dict[str, float] = {}  # since when
        self._began_at = 0.0
        self._up_since: float | None = None
        self._broker_trouble_at = 0.0
        self._outage_at = 0.0  # from when on a value that is told may be
        self._away_since: float | None = 0.0
        self._loss_orders: Counter[tuple[str, int]] = Counter()
        self._ended_losses = 0.0
        self._slept_at = self._slept_s = self._well_at = 0.0
        self.stopping_at: float | None = None
        self._open: dict[tuple[str, str, str], list[Wish]] = defaultdict(list)
        self._marks: set[str] = set()
        self.told_states: dict[str, bytes] = {}
        self._sent_here: set[str] = set()
        self._log: Counter[tuple[str, str, int]] = Counter()
        self.story: deque[str] = deque(maxlen=STORY_KEPT)

    def note(self, text: str) -> None:
        """Remember what happened, for the story of what broke."""
        self.story.append(f"{self.clockwork.now:.3f} {text}")

    # --- the house tells ----------------------------------------------------------------------

    def meet(self, line: str, config: StationConfig, module: SimulatedModule) -> None:
        """Add a module."""
        twin = SimulatedModule(
            config.model,
            config.address,
            clock=lambda: 0.0,
            listener=lambda _, s: self._orders.append((s.output, s.value)),
        )
        station = Station(line, config, module, twin)
        now = self.clockwork.now
        station.history = {
            n: deque([(now, False)], maxlen=64) for n in range(1, config.model.outputs + 1)
        }
        station.inputs = {
            n: deque([(now, False)], maxlen=64) for n in range(1, config.model.inputs + 1)
        }
        self.stations[config.id] = station
        self._by_place[line, config.address] = station

    def began(self, *, reload: bool = False) -> None:
        """The bridge starts."""
        self._began_at = self.clockwork.now
        self.is_down = False
        self.note("bridge begins")
        self._open.clear()  # what was not told by then goes with the broker of before
        self.stopping_at = None
        if reload and self.clockwork.now - self._ended_losses < 3.0:
            self._away_since = self._last_loss  # it ended while nobody looked any more
        elif not reload:
            self._away_since = None  # what was done in a loss is known to one process alone
        self._lose(self.clockwork.now)
        for line in self.lines:
            self.trouble(line)
        for station in self.stations.values():
            station.met_at = math.inf
            station.known_on.clear()
        if not reload:
            self._log.clear()  # the budgets of the log are a process'
            self.told_states.clear()

    def ended(self, outcome: RunResult) -> None:
        """The bridge ended."""
        if outcome is RunResult.FAILED and not self._motors_may_run():
            self._break("alive", "the bridge failed")
        now = self.clockwork.now
        for wishes in self._open.values():
            for wish in wishes:
                wish.judged, wish.judged_at = wish.judged or "ended", now
        self._open.clear()

    def stopping(self) -> None:
        """The bridge is asked to stop."""
        self.stopping_at = self.clockwork.now
        self.note("bridge stopping")
        for line in self.lines:
            self.halting(line)

    def gone(self) -> None:
        """The bridge is gone: it cannot answer any more."""
        self.is_down = True
        self._open.clear()
        self._lose(self.clockwork.now)

    def trouble_all(self) -> None:
        """Something is wrong on every line."""
        for line in self.lines:
            self.trouble(line)

    def slept(self, seconds: float) -> None:
        """The machine was suspended."""
        self._slept_at, self._slept_s = self.clockwork.now, seconds
        self._lose(self.clockwork.now)
        if seconds > HELD_S:
            self._open.clear()  # verdicts that waited are held no longer
            self._outage_at = self.clockwork.now
        self._began_at = max(self._began_at, self.clockwork.now)

    def _motors_may_run(self) -> bool:
        return any(
            s.covers and (s.covers & s.module.outputs or not self._calm(s, 10.0))
            for s in self.stations.values()
        )

    def loaded(self, config: Config) -> None:
        """The bridge read its file."""
        for old in self.config.lines:
            new = next((line for line in config.lines if line.id == old.id), None)
            if new != old or config.mqtt != self.config.mqtt:
                self.halting(old.id)
        self.config = config
        self.rules.loaded(config.rules)

    def halting(self, line: str) -> None:
        """A line is to end: its motors have to stand soon."""
        now = self.clockwork.now
        for station in self.stations.values():
            # What a hand did just now nobody may have read.
            running = station.covers & bits_of(
                n
                for n, at in station.on_since.items()
                if at < now - READ_S or station.heard.get((n, True), 0.0) >= at
            )
            if station.line == line and running and self._calm(station, 3.0):
                self.clockwork.after(STOP_S + 0.1, partial(self._halted, station, running, now))
        self._trouble_at[line] = now

    def _halted(self, station: Station, running: int, asked_at: float) -> None:
        left = bits_of(
            n
            for n in channels_of(running & station.module.outputs)
            if station.on_since.get(n, math.inf) <= asked_at  # else it was started since
        )
        touched = any(at > asked_at for at in station.hand_at.values())
        if left and not touched and self._trouble_at[station.line] <= asked_at + STOP_S:
            if not self._reached(station, asked_at):
                return
            self._break(
                "halt", f"{station.config.id} motor {left:b} runs since the stop", station.line
            )

    def _reached(self, station: Station, since: float) -> bool:
        return (
            station.away_since is None
            and station.line not in self.ports_gone
            and (self._trouble_at[station.line] <= since or self._began_at > since)
        )

    def trouble(self, line: str) -> None:
        """Something is wrong on a line just now."""
        self._trouble_at[line] = self.clockwork.now
        self.note(f"trouble {line}")

    def broker_trouble(self) -> None:
        """Something is wrong with the broker just now."""
        self._broker_trouble_at = self.clockwork.now

    def hand(self, station: Station, output: int, value: bool) -> None:
        """Handle a manual switching at the module."""
        self.note(f"hand {station.config.id} {output} {value}")
        station.hand_at[output] = self.clockwork.now
        station.module.set_output(output, value)

    def feed(self, station: Station, channel: int) -> None:
        """A contact changes."""
        station.module.toggle_input(channel)
        value = bool(station.module.inputs >> (channel - 1) & 1)
        station.inputs[channel].append((self.clockwork.now, value))
        station.changed_at = self.clockwork.now
        self.note(f"input {station.config.id} {channel} {value}")
        self.rules.happened(station, station.config.inputs[channel - 1], value)

    def read_so(self, name: str, channel: int, value: bool, since: float, until: float) -> bool:
        """Tell whether an input was so at any instant of a time."""
        return was(self.stations[name].inputs[channel], value, since, until)

    def mode(self, station: Station, output: int, *, pulse: bool, hold_s: float) -> None:
        """A tool changes a mode."""
        self.note(f"mode {station.config.id} {output} pulse {pulse}")
        station.mode_at[output] = self.clockwork.now
        station.module.set_mode(output, pulse=pulse, hold_s=hold_s)

    def away(self, station: Station, *, away: bool) -> None:
        """A module goes or comes back."""
        self.note(f"module {station.config.id} away {away}")
        now = self.clockwork.now
        if away and station.met_at < now - 3.0 and self._calm(station, 3.0):
            station.known_on = {n for n, at in station.on_since.items() if at < now - 3.0}
        station.module.away = away
        station.away_since = self.clockwork.now if away else None
        station.back_at = station.back_at if away else now
        self.trouble(station.line)

    def _calm(self, station: Station, seconds: float) -> bool:
        """Tell whether nothing was wrong with a module for so long."""
        if station.away_since is not None or station.line in self.ports_gone:
            return False
        return self.clockwork.now - self._trouble_at[station.line] > seconds

    # --- modules and wire ---------------------------------------------------------------------

    def switched(self, line: str, address: int, switching: Switching) -> None:
        """A module switched an output."""
        station = self._by_place[line, address]
        output = switching.output
        if switching.frame:
            station.heard[output, switching.value] = switching.at
        if not switching.changed:
            return
        self.note(f"module {station.config.id} {output} {switching.value} {switching.frame!r}")
        station.history[output].append((switching.at, switching.value))
        station.changed_at = switching.at
        if switching.value:
            station.on_since[output] = switching.at
        else:
            station.on_since.pop(output, None)
            station.known_on.discard(output)
            if switching.frame:
                station.ordered_off[output] = switching.at

    def sent(self, line: str, at: float, frame: bytes) -> None:
        """A frame that may switch something went out."""
        self.counts["writes"] += 1
        for station in self.stations.values():
            if station.line != line:
                continue
            self._is_wisco = frame.startswith(b"#")
            self._orders.clear()
            station.twin.write_outputs(0, 0, b"")
            if reply_of(station.twin, frame, failing=False) is not None and self._orders:
                self._judge_orders(station, dict(self._orders), at)

    def _judge_orders(self, station: Station, orders: dict[int, bool], at: float) -> None:
        self._look_through(station, at)
        direct, taken = set[int](), list[Wish]()
        ends = {min(orders), max(orders)}
        is_on = station.module.outputs
        whole = self._whole(station, orders, at)
        if whole is not None:
            taken.append(whole)
        for output in sorted(orders, key=lambda n: n not in ends):
            value = orders[output]
            same = next((w for w in taken if w.wants(output, value)), None)
            inside = output not in ends
            if same is not None and not (inside and bool(is_on >> (output - 1) & 1) is value):
                same.use(output, at, value)
            elif inside and (
                bool(is_on >> (output - 1) & 1) is value
                or at - station.history[output][-1][0] < RACE_S
            ):
                if same is None:
                    self._judge_gap(station, output, value, at)
                continue
            elif not self._licence(station, output, value, at, taken, alone=len(orders) == 1):
                judge = self._judge_gap if inside and direct else self._judge_unasked
                judge(station, output, value, at)
                continue
            direct.add(output)
        for output, value in orders.items():
            if self._output(station, output).read_only:
                self._break("read-only", f"{station.config.id} output {output}", station.line)
            if value and (output in direct):
                self._judge_interlock(station, output, orders, at)

    def _output(self, station: Station, output: int) -> OutputConfig:
        return next(one for one in station.config.outputs if one.channel == output)

    def _whole(self, station: Station, orders: dict[int, bool], at: float) -> Wish | None:
        """Find a wish that a frame carries out as a whole, from its first output to its last."""
        ends = {min(orders), max(orders)}
        able = [
            wish
            for wish in station.wishes
            if len(wish.values) > 1
            and wish.judged is None
            and ends <= set(wish.values) <= set(orders)
            and all(wish.may(n, orders[n], at, LATCH_TIMES) for n in wish.values)
        ]
        able.sort(key=lambda w: (len(w.values), len(w.uses), w.deadline))
        is_on, pulse = station.module.outputs, station.module.settings.pulse
        for wish in able:
            between = bits_of(n for n in orders if n not in wish.values)
            values = bits_of(n for n, value in orders.items() if value)
            if not (is_on ^ values) & between and not values & pulse & between:
                return wish  # the least that explains all of it
        return able[-1] if able else None

    def _licence(
        self,
        station: Station,
        output: int,
        value: bool,
        at: float,
        taken: list[Wish],
        *,
        alone: bool,
    ) -> bool:
        """Find what asked for this, and count it."""
        if station.covers >> (output - 1) & 1 and not value:
            return True  # a motor that is switched OFF needs no reason
        pulse = bool(station.module.settings.pulse >> (output - 1) & 1)
        times = PULSE_TIMES if pulse and value else LATCH_TIMES
        if at - station.mode_at.get(output, 0.0) < 3.0:
            times = LATCH_TIMES
        able = [w for w in station.wishes if w.may(output, value, at, times)]
        able = [w for w in able if pulse or not w.press] or able
        fresh_ones = [w for w in able if not w.uses.get(output)]
        if alone and not fresh_ones and self._rule(station, output, at, value):
            self._count_loss(station, output, at, value)
            return True
        if not able:
            return self._explained(station, output, times, extra=(at, value))
        fresh = [wish for wish in able if not wish.uses.get(output)]
        wish = min(fresh or able, key=lambda w: w.rank(output, pulse=pulse))
        overtaken = [] if fresh or pulse else self._overtaken(station, output, at)
        if wish in overtaken:
            if self._explained(station, output, times, extra=(at, value), once=overtaken):
                return True
            self._break("latch", f"{station.config.id} output {output} again", station.line)
        settled = at - station.mode_at.get(output, 0.0) > RACE_S
        # Without Modbus frames (docs/contract.md, promise 6) modes cannot be asked for.
        asked = not self._is_wisco
        if wish.press and not pulse and settled and asked:
            if self._explained(station, output, times, without=wish, extra=(at, value)):
                return True  # an earlier frame was not for what it was counted for
            self._break("press", f"{station.config.id} output {output}", station.line)
        self.rules.used(wish, at)
        wish.use(output, at, value)
        taken.append(wish)
        return True

    def _explained(
        self,
        station: Station,
        output: int,
        times: int,
        *,
        without: Wish | None = None,
        extra: Use | None = None,
        once: Sequence[Wish] = (),
    ) -> bool:
        """Tell whether every frame that switched an output can be for a wish or a rule.

        `without` is a wish for which none may be, `extra` a frame that is not counted yet; one
        frame at most is for each of `once`.
        """
        uses = [use for wish in station.wishes for use in wish.uses.get(output, ())]
        uses += [] if extra is None else [extra]
        seats = [w for w in station.wishes if w is not without and output in w.values]
        # What was taken for a latch stays taken, though the output is a pulse by now.
        matched = match_all(
            uses,
            [(w, 1 if w in once else max(times, len(w.uses.get(output, ())))) for w in seats],
            output,
            lambda use: self._rule(station, output, *use),
        )
        if matched is None:
            return False
        for wish in station.wishes:
            wish.uses.pop(output, None)
        for wish, use in matched:
            wish.use(output, *use)
        return True

    def _overtaken(self, station: Station, output: int, at: float) -> list[Wish]:
        """Return what may not be said again, as a newer command for that output waits."""
        open_ones = [  # what an event would order may never come to be one
            w
            for w in station.wishes
            if output in w.values and w.judged is None and not (w.barred or w.by)
        ]
        waiting = [w.arrived for w in open_ones if w.arrived < at - 0.3 and w.deadline > at + 0.1]
        newest = max(waiting, default=-math.inf)
        return [w for w in station.wishes if w.arrived + 0.01 < newest]

    def _rule(self, station: Station, output: int, at: float, value: bool) -> bool:
        """Tell whether a rule of the house orders this."""
        config = self._output(station, output)
        history = station.history[output]
        changed_at = station.mode_at.get(output, -math.inf)
        ordered_at = station.heard.get((output, True), -math.inf)
        if not value and at - changed_at < 70.0 and at - ordered_at < 2.0:
            return True  # what was a pulse, and would stay ON, is ended
        if config.max_on_s is not None and not value:
            since = at - config.max_on_s
            if was(history, True, since - 200.0, since + 0.3):
                return True
        if config.on_loss is not None and config.on_loss.on is value:
            lost = self._lost_since()
            return lost is not None and at >= lost + config.on_loss.after_s - 0.05
        return False

    def _count_loss(self, station: Station, output: int, at: float, value: bool) -> None:
        """Count what on_loss ordered."""
        rule, since = self._output(station, output).on_loss, self._lost_since()
        if rule is None or rule.on is not value or since is None or since + rule.after_s > at:
            return
        key = station.config.id, output
        self._loss_orders[key] += 1
        pulse = bool(station.module.settings.pulse >> (output - 1) & 1)
        most = 1 if pulse and value else 2
        started = max(since, self._trouble_at[station.line])
        if self._loss_orders[key] > most and (most == 1 or at - started > CALM_S):
            text = f"{key[0]} output {output}: {self._loss_orders[key]} orders in one loss"
            self._break("on-loss", text, station.line)

    def _lost_since(self) -> float | None:
        """Since when the broker is away at the earliest."""
        now = self.clockwork.now
        if self._broker.away(now) and self._away_since is None:
            link = self._broker.link
            silent = link is not None and link.settled_at is not None
            self._lose(link.fresh_at + 3.0 if link is not None and silent else now)
        if self._away_since is None and now - self._ended_losses < 2.5:
            return self._last_loss
        return self._away_since

    _last_loss: float | None = None

    def _lose(self, since: float) -> None:
        if self._away_since is None:
            self._away_since = since
            self._loss_orders.clear()

    def looked(self) -> None:
        """Take in whether the broker was away up to now."""
        self._lost_since()

    def came_back(self) -> None:
        """A ping proves the broker."""
        if self._away_since is not None:
            self._last_loss, self._away_since = self._away_since, None
            self._ended_losses = self.clockwork.now

    def _judge_gap(self, station: Station, output: int, value: bool, at: float) -> None:
        is_on = bool(station.module.outputs >> (output - 1) & 1)
        pulse = bool(station.module.settings.pulse >> (output - 1) & 1)
        if is_on is not value and at - station.history[output][-1][0] > RACE_S:
            text = f"{station.config.id} output {output} written {value} over {is_on}"
            self._break("gap", text, station.line)
        if pulse and value and at - station.mode_at.get(output, 0.0) > 2.5:
            self._break("gap", f"{station.config.id} output {output}: a pulse anew", station.line)

    def _judge_unasked(self, station: Station, output: int, value: bool, at: float) -> None:
        near = [wish for wish in station.wishes if wish.wants(output, value)]
        what = f"{station.config.id} output {output} {'ON' if value else 'OFF'}"
        if any(wish.barred for wish in near):
            reasons = {wish.barred for wish in near if wish.barred}
            self._break("barred", f"{what}: {reasons}", station.line)
        elif any(wish.deadline < at for wish in near):
            self._break("late", f"{what}: {[(w.key, w.deadline) for w in near]}", station.line)
        elif near:
            pulse = bool(station.module.settings.pulse >> (output - 1) & 1)
            self._break(
                "pulse" if pulse else "latch", f"{what}: {[w.key for w in near]}", station.line
            )
        else:
            self._break("unasked", what, station.line)

    def _judge_interlock(
        self, station: Station, output: int, orders: dict[int, bool], at: float
    ) -> None:
        for group in station.config.interlock:
            if not group >> (output - 1) & 1:
                continue
            for other in range(1, station.config.model.outputs + 1):
                if other == output or not group >> (other - 1) & 1:
                    continue
                since = station.on_since.get(other)
                if orders.get(other) or (since is not None and at - since > RACE_S):
                    text = f"{station.config.id} output {output} ON, {other} is ON"
                    self._break("interlock", text, station.line)
                off_at = station.ordered_off.get(other, -math.inf)
                last = station.history[other][-1]
                dead_s = station.config.interlock_dead_s
                began_at = self._last_on(station, other)
                known = began_at < off_at - READ_S
                known = known or station.heard.get((other, True), -math.inf) >= began_at
                early = at - off_at < dead_s - 0.001
                if known and not last[1] and last[0] == off_at and early:
                    text = f"{station.config.id} output {output} {at - off_at:.3f} s after {other}"
                    self._break("dead-time", text, station.line)

    def _last_on(self, station: Station, output: int) -> float:
        """Return when an output last went ON."""
        return next((at for at, on in reversed(station.history[output]) if on), -math.inf)

    def _look_through(self, station: Station, now: float) -> None:
        oldest = now - KEPT_S
        station.wishes = [w for w in station.wishes if max(w.deadline, w.judged_at) > oldest]
        for wish in station.wishes:
            wish.look(now)

    # --- the broker ---------------------------------------------------------------------------

    def connection(self, *, up: bool) -> None:
        """A connection began or ended."""
        self._sent_here.clear()
        self.note(f"bridge connected {up}")
        self.broker_trouble()
        if up:
            self._up_since = self.clockwork.now
            self._drop_held(self.clockwork.now - HELD_S)
        else:
            if self._up_since is not None:
                self._outage_at = self.clockwork.now
            self._up_since = None
            self._lose(self.clockwork.now)

    def _drop_held(self, before: float) -> None:
        """Expect no verdict on what arrived before: held for so long, it may be dropped."""
        for key, wishes in list(self._open.items()):
            self._open[key] = [wish for wish in wishes if wish.arrived > before]
            if not self._open[key]:
                del self._open[key]

    def arrived(self, received: Received, published_at: float, *, live: bool) -> None:
        """The bridge was handed a message."""
        covers = {name: station.covers for name, station in self.stations.items()}
        now = self.clockwork.now
        self.rules.arrived(received)
        wish = read_wish(received.topic, received.payload, now, covers)
        if wish is None:
            return
        self.counts["commands"] += 1
        station = self.stations[wish.station_id]
        if received.expiry_s is not None:
            wish.deadline = min(wish.deadline, now + received.expiry_s)
        if received.retain:
            wish.barred = "retained"
        elif not live:
            wish.barred = "stored"
        elif not self._broker.proven(now):
            wish.barred = "unproven"
        elif now - published_at > 3.0 + 0.2:
            wish.barred = "stale"
        if wish.command_id in self._marks:
            wish.barred = wish.barred or "twice"
        elif wish.command_id is not None and wish.barred is None:
            self._marks.add(wish.command_id)  # what was refused unseen may be asked again
        self.note(f"asked {wish.key} {wish.payload} {wish.barred or ''}")
        station.wishes.append(wish)
        if self.stopping_at is None:
            self._open[wish.key].append(wish)

    def told(self, topic: str, payload: bytes, retain: bool) -> None:
        """The broker has what the bridge published."""
        self.counts["messages"] += 1
        parts = topic.split("/")
        if topic.endswith("/result"):
            self._judge_verdict(parts[1], topic, payload)
        elif retain and len(parts) == 4 and parts[2] in {"di", "do"} and payload:
            self._judge_state(topic, parts, payload)
        elif retain and len(parts) == 3 and parts[2] == "availability":
            self._judge_online(parts[1], payload)
        elif retain and parts[1:3] == ["bridge", "rule"]:
            self.rules.told(parts[3], payload)
        if retain:
            self._sent_here.add(topic)

    def _judge_state(self, topic: str, parts: list[str], payload: bytes) -> None:
        if self.told_states.get(topic) == payload:
            return
        self.told_states[topic] = payload
        station = self.stations[parts[1]]
        now = self.clockwork.now
        station.module.settle()
        since = min(now, self._well_at) - 6.0  # else it had to wait for the broker
        if now - self._slept_at < 12:  # it may have been read before
            since = min(since, self._slept_at - self._slept_s - 6.0)
        histories = station.inputs if parts[2] == "di" else station.history
        if not was(histories[int(parts[3])], payload == b"ON", since, now):
            self._break("false-state", f"{topic} {payload!r}", station.line)

    def _judge_online(self, name: str, payload: bytes) -> None:
        station = self.stations.get(name)
        if station is None:
            return
        self.note(f"told {name} {payload!r}")
        if payload != b"online":
            station.met_at = math.inf
            return
        if station.met_at is math.inf:
            station.met_at = self.clockwork.now
        if self._broker.retained.get(STATE) != b"online":
            return
        missing = [
            topic
            for topic in (f"wisco/{name}/do/{n}" for n in station.history)
            if topic not in self.told_states
        ]
        if missing:
            self._break("order", f"{name} online before {missing[0]}", station.line)

    def _judge_verdict(self, name: str, topic: str, payload: bytes) -> None:
        again = (topic, payload) in self._broker.lost_verdicts
        if again:
            self._broker.lost_verdicts.remove((topic, payload))
        verdict = json.loads(payload)
        self.note(f"verdict {name} {payload.decode()}")
        if "by" in verdict:
            if verdict["by"].startswith("rule ") and not again:
                self._judge_rule(name, verdict)
            return
        self.counts[f"{verdict['status']} {verdict.get('reason', '')}".strip()] += 1
        key = key_of(name, verdict["target"], verdict["payload"], verdict.get("id"))
        open_wishes = self._open.get(key)
        if not open_wishes:
            resent = again or self.clockwork.now - self._outage_at < HELD_S
            if not resent and self.stopping_at is None:
                self._break("verdict", f"{key} has none left: {verdict}")
            return
        alike = [
            w for w in open_wishes if (w.barred is not None) is (verdict.get("reason") in _BARRED)
        ]
        if not alike and verdict.get("reason") == "duplicate":
            return  # on one that was forgotten here
        arrived = self.clockwork.now - int(verdict["ms"]) / 1000
        wish = min(alike or open_wishes, key=lambda w: abs(w.arrived - arrived))
        open_wishes.remove(wish)
        if not open_wishes:
            del self._open[key]
        wish.judged, wish.judged_at = verdict["status"], self.clockwork.now
        self._judge_status(self.stations[name], wish, verdict)

    def _judge_rule(self, name: str, verdict: dict[str, Any]) -> None:
        """Judge the verdict on an order of a rule, where it came at once."""
        self.counts[f"by rule {verdict['status']}"] += 1
        if not self.broker_well(HELD_S) or self.clockwork.now - self._outage_at < HELD_S:
            return
        wish = self.rules.find(self.stations[name], verdict)
        if wish is None:
            self._break("verdict", f"{name}: there was no event for {verdict}")
            return
        wish.judged, wish.judged_at = str(verdict["status"]), self.clockwork.now
        self._judge_status(self.stations[name], wish, verdict)

    def _judge_status(self, station: Station, wish: Wish, verdict: dict[str, object]) -> None:
        if wish.setting or wish.barred or wish.target.startswith("cover"):
            return
        if verdict["status"] == "refused":
            for output, uses in list(wish.uses.items()):
                if not self._explained(station, output, LATCH_TIMES, without=wish):
                    self._break("refused", f"{wish.key} {verdict} sent {uses}", station.line)
        if verdict["status"] == "done" and verdict.get("seen_on") is not False and not wish.press:
            station.module.settle()
            for output, wanted in wish.values.items():
                pulse = bool(station.module.settings.pulse >> (output - 1) & 1)
                settled = self.clockwork.now - station.mode_at.get(output, 0.0) > 5.0
                if wanted is not None and settled and not pulse:
                    self._judge_done(station, wish, output, wanted)

    def _judge_done(self, station: Station, wish: Wish, output: int, wanted: bool) -> None:
        history = station.history[output]
        if not was(history, wanted, wish.arrived, self.clockwork.now):
            self._break("done", f"{wish.key} output {output} {wanted}", station.line)
            return
        topic = f"wisco/{station.config.id}/do/{output}"
        told = self.told_states.get(topic)
        if told is None or (told == b"ON") is wanted:
            return
        if not self._turned_after(history, wanted, wish.arrived):
            self._break("state-first", f"{wish.key}: {topic} is {told!r}", station.line)

    def _turned_after(self, history: deque[tuple[float, bool]], wanted: bool, since: float) -> bool:
        """Tell whether it was as wanted and then otherwise again."""
        seen = False
        for at, value in history:
            if value is wanted:
                seen = True
            elif seen and at >= since:
                return True
        return False

    # --- what falls due -----------------------------------------------------------------------

    def watch(self) -> None:
        """Look at what should have happened by now."""
        now = self.clockwork.now
        self._lost_since()
        if self.broker_well(CALM_S):
            self._well_at = now
        if self._began_at == 0.0 or self.stopping_at is not None:
            return
        for station in self.stations.values():
            if station.on_since:
                station.module.settle()
            for output, since in list(station.on_since.items()):
                self._judge_on(station, output, since, now)
            self._judge_silent(station, now)
        self._judge_open(now)

    def _judge_on(self, station: Station, output: int, since: float, now: float) -> None:
        limit_s, slack_s, promise = math.inf, 0.0, ""
        config = self._output(station, output)
        if station.covers >> (output - 1) & 1:
            cover = station.config.covers[0]
            way = cover.open_s if cover.open == output else cover.close_s
            limit_s, slack_s, promise = way + max(way * 0.05, 0.5) + 4.0, 7.0, "motor"
        elif config.max_on_s is not None:
            limit_s, slack_s, promise = config.max_on_s + 4.0, 9.0, "max-on"
        if self._is_contested(station):
            limit_s += 5.0  # several reads apart have to agree (docs/contract.md, promise 5)
        if output not in station.known_on:
            since = max(since, station.met_at, station.back_at + FOUND_S)
        if limit_s is math.inf or now < since + limit_s or not self._calm(station, slack_s):
            return
        if now < self._began_at + limit_s + 3.0 or now < self._restarted(station) + limit_s + 3.0:
            return
        del station.on_since[output]  # told once
        self._break(
            promise, f"{station.config.id} output {output} ON for {now - since:.1f} s", station.line
        )

    def _is_contested(self, station: Station) -> bool:
        """Tell whether replies without an address may have been taken for another master's."""
        frames = self.lines[station.line].wire
        unprotected = any(frame.startswith(b"#") for _, frame in frames)
        return unprotected and not self._calm(station, CONTESTED_S)

    def _restarted(self, station: Station) -> float:
        return self._port_at.get(station.line, 0.0)

    def restarted(self, line: str) -> None:
        """A line is to start anew: what it knew is gone."""
        self._port_at[line] = self.clockwork.now

    def _is_flooded(self, line: str, now: float) -> bool:
        """Tell whether commands took much of a line: a silent module is asked less often then."""
        arrived = (
            wish.arrived for s in self.stations.values() if s.line == line for wish in s.wishes
        )
        return sum(at > now - FLOOD_S for at in arrived) >= FLOOD

    def _judge_silent(self, station: Station, now: float) -> None:
        limit_s = SILENT_S + (FLOODED_S if self._is_flooded(station.line, now) else 0.0)
        if station.away_since is None or now - station.away_since < limit_s:
            return
        if not self.broker_well(CALM_S) or now - self._began_at < 8:
            return
        told = self._broker.retained.get(f"wisco/{station.config.id}/availability")
        if told == b"online":
            station.away_since = now
            self._break("offline", f"{station.config.id} is silent and online", station.line)

    def broker_well(self, seconds: float) -> bool:
        """Tell whether nothing was wrong with the broker for so long."""
        now = self.clockwork.now
        return self._broker.proven(now) and now - self._broker_trouble_at > seconds

    def _judge_open(self, now: float) -> None:
        if not self._open or not self.broker_well(CALM_S):
            return
        for key, wishes in list(self._open.items()):
            for wish in list(wishes):
                if now > max(wish.deadline, self._began_at, self._broker_trouble_at) + 8.0:
                    self._break("verdict", f"{key} has none, arrived {wish.arrived:.3f}")
                    wishes.remove(wish)
            if not wishes:
                del self._open[key]

    def judge_calm(self) -> None:
        """Nothing was wrong for a while: everything told has to be true."""
        now = self.clockwork.now
        for name, station in self.stations.items():
            if self._broker.retained.get(f"wisco/{name}/availability") != b"online":
                self._break("old-state", f"{name} is not online after a calm time", station.line)
                continue
            outputs, inputs = station.module.outputs, station.module.inputs
            if now - station.changed_at < CALM_S:
                continue
            truth = {f"wisco/{name}/do/{n}": bool(outputs >> (n - 1) & 1) for n in station.history}
            truth |= {f"wisco/{name}/di/{n}": bool(inputs >> (n - 1) & 1) for n in station.inputs}
            for topic, value in truth.items():
                if self._broker.retained.get(topic) != (b"ON" if value else b"OFF"):
                    self._break("old-state", f"{topic} should be {value}", station.line)

    # --- the log ------------------------------------------------------------------------------

    def logged(self, record: logging.LogRecord) -> None:
        """A line was logged."""
        text = _NUMBERS.sub("#", record.getMessage())
        hour = int(self.clockwork.now // 3600)
        key = record.name, text[:80], hour
        self._log[key] += 1
        if record.levelno >= logging.CRITICAL:
            self._break("alive", record.getMessage())
        if self._log[key] == LINES_AN_HOUR + 1:
            self._break("log", f"{record.name}: {text[:120]}")

    def _break(self, promise: str, text: str, line: str | None = None) -> None:
        if promise in self.off:
            return
        wire = self.lines[line].wire if line is not None else ()
        frames = [f"{at:.3f} {frame!r}" for at, frame in list(wire)[-8:]]
        name = text.partition(" ")[0]
        name = name if name in self.stations else ""
        near = [one for one in self.story if name in one or "trouble" in one or "bridge" in one]
        story = [one for one in near if f"trouble {line}" in one or "trouble" not in one]
        self.broken.append(
            Broken(promise, self.clockwork.now, text, (*frames, *story[-STORY_TOLD:]))
        )
