"""Tells the broker what the hub publishes."""

import json
import logging
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from typing import Any, assert_never

from bridge import __version__
from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.config.current import CurrentConfig
from bridge.config.schema import Config
from bridge.model import (
    CountChanged,
    CoverChanged,
    GestureMade,
    LineChanged,
    LineMeasured,
    OutputSettings,
    ProblemChanged,
    PublicEvent,
    ReplyTo,
    RuleFired,
    RuleSwitched,
    SettingsRead,
    StationChanged,
    StationMeasured,
    Status,
    ValuesChanged,
    Verdict,
)
from bridge.mqtt import diagnostics, payloads
from bridge.mqtt.events import OutMessage
from bridge.mqtt.log_handler import LogLine
from bridge.mqtt.outbox import Outbox
from bridge.mqtt.own_actions import OwnActions
from bridge.mqtt.retained import availability, in_order, states
from bridge.mqtt.topics import Topics

_log = logging.getLogger(__name__)

_PAYLOAD_CHARS = 64
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_WALL_JUMP_S = 2.0  # less is drift, or a leap second


class MqttPublisher:
    """Puts states, availability and verdicts into the outbox. Only the main thread calls it.

    The outbox drops values that a topic has already, so everything may be reported twice. `clock`
    is `bridge.clock.boot_s`; `wall_clock` returns times with a zone. Instants are kept in `clock`
    and converted with the present wall clock when they are published: a computer without a battery
    starts with a wrong time (docs/failures.md F21).
    """

    def __init__(
        self,
        current: CurrentConfig,
        topics: Topics,
        outbox: Outbox,
        *,
        clock: Callable[[], float],
        wall_clock: Callable[[], datetime],
        budgets: Budgets | None = None,
    ) -> None:
        """Create it; `budgets` limit its log lines."""
        self._bounded = BoundedLog(_log, clock, budgets)
        self._current = current
        self._topics = topics
        self._outbox = outbox
        self._started = clock()
        self._protocol: str | None = None  # of the last connection
        self._wall_offset = _offset(clock, wall_clock)
        self._clock = clock
        self._wall_clock = wall_clock
        self._problems: dict[str, tuple[str, str, float]] = {}  # station: reason, detail, since
        self._own_actions = OwnActions()

    # --- what lines and hub report --------------------------------------------------------------

    def publish(self, event: PublicEvent) -> None:  # noqa: C901, PLR0912  # a case for each event
        """Publish what changed."""
        match event:
            case LineChanged(line, online):
                self._tell_availability(self._topics.line_availability(line), online)
            case StationChanged(station_id, online):
                self._tell_availability(self._topics.availability(station_id), online)
            case ValuesChanged(station_id, inputs, outputs):
                self._values(station_id, inputs, outputs)
            case GestureMade():
                self._gesture(event)
            case RuleFired():
                self._rule_fired(event)
            case RuleSwitched(rule, on):
                self._retain(self._topics.rule_state(rule), payloads.on_off(on))
            case CountChanged(station_id, channel, edges):
                self._retain(self._topics.count(station_id, channel), payloads.count(edges))
            case SettingsRead(station_id, settings):
                self._settings(station_id, settings)
            case CoverChanged():
                self._cover(event)
            case ProblemChanged(station_id, reason, detail):
                self._problem(station_id, reason, detail)
            case LineMeasured() | StationMeasured():
                self._measured(event)
            case Verdict():
                self._verdict(event)
            case _:
                assert_never(event)

    def _values(self, station_id: str, inputs: int, outputs: int) -> None:
        """Publish the channels that changed, then the snapshot; nothing if no channel changed."""
        config = self._current.stations[station_id]
        for channel in config.inputs:
            topic = self._topics.channel(station_id, "di", channel.channel)
            self._retain(topic, payloads.on_off(bool(inputs >> (channel.channel - 1) & 1)))
        for output in config.outputs:
            topic = self._topics.channel(station_id, "do", output.channel)
            self._retain(topic, payloads.on_off(bool(outputs >> (output.channel - 1) & 1)))
        self._retain(self._topics.snapshot(station_id), payloads.snapshot(config, inputs, outputs))

    def _gesture(self, made: GestureMade) -> None:
        """Publish a press of an input: not retained, and dropped while the broker is away."""
        topic = self._topics.event(made.station_id, made.channel)
        self._put(OutMessage(topic, payloads.gesture(made.gesture), qos=0, retain=False))

    def _rule_fired(self, fired: RuleFired) -> None:
        """Publish that a rule acts, or why it does not: like a press."""
        topic = self._topics.rule_event(fired.rule)
        self._put(OutMessage(topic, payloads.rule_event(fired.held), qos=0, retain=False))

    def _settings(self, station_id: str, settings: OutputSettings | None) -> None:
        """Publish modes and hold times; clear the topics if they could not be read."""
        for output in self._current.stations[station_id].outputs:
            index = output.channel - 1
            mode = hold = payloads.CLEARED
            if settings is not None:
                mode = payloads.mode(bool(settings.pulse >> index & 1))
                hold = payloads.hold(settings.hold_ds[index])
            self._retain(self._topics.mode(station_id, output.channel), mode)
            self._retain(self._topics.hold(station_id, output.channel), hold)

    def _cover(self, changed: CoverChanged) -> None:
        """Publish the state of a cover and its position; clear the topic if it is not known."""
        where = changed.station_id, changed.cover
        # The position first: Home Assistant uses it to decide whether a `stopped` cover is open.
        self._retain(self._topics.cover_position(*where), payloads.position(changed.position))
        self._retain(self._topics.cover_state(*where), payloads.cover_state(changed))

    def _problem(self, station_id: str, reason: str | None, detail: str) -> None:
        """Publish a problem, or that there is none; `since` is when this reason began."""
        if reason is None:
            self._problems.pop(station_id, None)
            self._retain(self._topics.problem(station_id), payloads.no_problem())
            return
        known, _, since = self._problems.get(station_id, (None, "", 0.0))
        if known != reason:
            since = self._clock()
        self._problems[station_id] = (reason, detail, since)
        self._tell_problem(station_id)

    def _tell_problem(self, station_id: str) -> None:
        reason, detail, since = self._problems[station_id]
        payload = payloads.problem(reason, detail, self._wall(since))
        self._retain(self._topics.problem(station_id), payload)

    def _measured(self, measured: LineMeasured | StationMeasured) -> None:
        """Tell how a line or a module did lately."""
        if isinstance(measured, LineMeasured):
            topic = self._topics.line_diagnostics(measured.line)
            payload = diagnostics.of_line(measured)
        else:
            topic = self._topics.diagnostics(measured.station_id)
            last_seen = None if measured.last_seen is None else self._wall(measured.last_seen)
            payload = diagnostics.of_station(measured, last_seen)
        self._put(OutMessage(topic, payload, qos=0, retain=True))

    def _verdict(self, verdict: Verdict) -> None:
        """Publish the verdict on one command, also to the response topic of its sender."""
        self._log_verdict(verdict)
        payload = payloads.verdict(verdict)
        self._put(OutMessage(self._topics.result(verdict.station_id), payload, qos=1, retain=False))
        if verdict.is_own:
            self._own_actions.add(verdict, self._clock())
            self._tell_own_actions(verdict.station_id)
        if isinstance(verdict.reply_to, ReplyTo):
            correlation = verdict.reply_to.correlation or None
            reply = OutMessage(verdict.reply_to.topic, payload, 1, False, correlation)
            self._put(reply)

    def _tell_own_actions(self, station_id: str) -> None:
        payload = self._own_actions.payload(station_id, self._wall)
        self._retain(self._topics.own_actions(station_id), payload)

    def _log_verdict(self, verdict: Verdict) -> None:
        """Log a command that was not done.

        Its line logs what `max_on`, `on_loss` and covers order.
        """
        by_rule = verdict.by is not None and verdict.by.startswith("rule ")
        is_told = verdict.status is Status.DONE or (verdict.is_own and not by_rule)
        if is_told and not _log.isEnabledFor(logging.DEBUG):
            return
        station_id, reason = verdict.station_id, verdict.reason or ""
        asked = f"{station_id} {verdict.target} {verdict.payload!a:.{_PAYLOAD_CHARS}}"
        asked += f" by {verdict.by}" if by_rule else ""
        outcome = ": ".join(filter(None, (verdict.status, reason, verdict.detail)))
        _log.debug("%s: %s (%d ms)", asked, outcome, verdict.ms)
        if not is_told:
            text, extra = f"{asked}: {outcome}", {"station": station_id}
            subject = f"{station_id} {reason}"
            self._bounded.tell(Cause.COMMAND, subject, logging.WARNING, text, extra)

    def config_replaced(self, before: Config) -> set[str]:
        """Go on after a reload.

        Returns:
            The retained topics that have no values any more, and had some `before`.
        """
        stations = self._current.stations
        self._problems = {s: since for s, since in self._problems.items() if s in stations}
        self._own_actions.keep(stations)
        self.assume_offline()
        return set(in_order(before, self._topics)) - set(self.order())

    # --- what the bridge tells of itself ------------------------------------------------------

    def bridge_state(self, online: bool) -> None:
        """Publish whether the bridge is online; the last will also says `offline`."""
        self._tell_availability(self._topics.bridge_state, online)

    def bridge_info(self, protocol: str) -> None:
        """Publish version, lines and the MQTT version in use."""
        self._protocol = protocol
        started = self._wall(self._started)
        info = payloads.bridge_info(self._current.config, __version__, started, protocol)
        self._retain(self._topics.bridge_info, info)

    def follow_wall_clock(self) -> None:
        """Publish again everything with a time in it, if the wall clock was set."""
        offset = _offset(self._clock, self._wall_clock)
        if abs(offset - self._wall_offset) < _WALL_JUMP_S:
            return
        self._wall_offset = offset
        if self._protocol is not None:
            self.bridge_info(self._protocol)
        for station_id in self._problems:
            self._tell_problem(station_id)
        for station_id in self._own_actions.station_ids:
            self._tell_own_actions(station_id)

    def diagnostics(self) -> dict[str, Any]:
        """Return the content of the diagnostics topics; null if nothing was measured yet."""
        topics, config = self._topics, self._current.config
        lines = {line.id: self._document(topics.line_diagnostics(line.id)) for line in config.lines}
        stations = {
            station_id: self._document(topics.diagnostics(station_id))
            for station_id in self._current.stations
        }
        return {"lines": lines, "stations": stations}

    def log(self, line: LogLine) -> None:
        """Publish one warning or error; dropped while the broker is away."""
        payload = payloads.log_line(line.level, line.message, line.line, line.station_id)
        self._put(OutMessage(self._topics.bridge_log, payload, qos=0, retain=False))

    def assume_offline(self) -> None:
        """Publish as offline every line and station that was not reported yet."""
        for topic in availability(self._current.config, self._topics):
            if self._outbox.latest(topic) is None:
                self._retain(topic, payloads.OFFLINE)

    def all_offline(self) -> None:
        """Publish the bridge as offline, then lines and stations, at a clean stop.

        In the other order each connection would be seen off, as if its module or port were lost.
        """
        topics = availability(self._current.config, self._topics)
        for topic in (self._topics.bridge_state, *topics):
            self._retain(topic, payloads.OFFLINE)

    def order(self) -> Iterator[str]:
        """Yield the retained topics of lines and stations in the order of a connect.

        See docs/contract.md.
        """
        return in_order(self._current.config, self._topics)

    def repeated(self) -> Iterator[str]:
        """Yield the topics of a repeat: what is offline, then states, then what is online.

        So a client that missed both the return of a module and its new state gets the state first.
        Diagnostics go out once a minute and are not repeated.
        """
        config = self._current.config
        there = list(availability(config, self._topics))
        gone = [topic for topic in there if self._outbox.latest(topic) == payloads.OFFLINE]
        yield from gone
        yield from states(config, self._topics)
        yield from (topic for topic in there if topic not in gone)

    def _tell_availability(self, topic: str, online: bool) -> None:
        # Coming up: states, then `online`, even if an earlier `offline` still waits.
        message = OutMessage(topic, payloads.availability(online), qos=1, retain=True)
        self._outbox.put(message, self._clock(), at_end=online)

    def _retain(self, topic: str, payload: bytes) -> None:
        self._put(OutMessage(topic, payload, qos=1, retain=True))

    def _document(self, topic: str) -> Any:
        payload = self._outbox.latest(topic)
        return None if payload is None else json.loads(payload)

    def _wall(self, instant: float) -> datetime:
        """Return the wall clock time of an instant, by the present setting of the wall clock."""
        at = _EPOCH + timedelta(seconds=instant + self._wall_offset)
        return at.astimezone(self._wall_clock().tzinfo)

    def _put(self, message: OutMessage) -> None:
        self._outbox.put(message, self._clock())


def _offset(clock: Callable[[], float], wall_clock: Callable[[], datetime]) -> float:
    return wall_clock().timestamp() - clock()
