"""Decides which arriving commands go on to the lines, and refuses the others with a verdict."""

import logging
import time
from collections.abc import Callable

from bridge.bounded_log import BoundedLog, Budgets, Cause
from bridge.config.current import CurrentConfig
from bridge.model import AnyCommand, Publish, Reason, Status, Verdict
from bridge.mqtt.commands import BadCommandError, parse_command, reply_to
from bridge.mqtt.events import Received
from bridge.mqtt.link import STALE_WORDS, LinkCheck
from bridge.mqtt.topics import CommandTarget, CoverTarget, RuleTarget, Topics

_log = logging.getLogger(__name__)

_SHOWN_CHARS = 48  # the maximum length of an id
_SWITCHED = {b"ON": True, b"OFF": False}

SwitchRule = Callable[[str, bool], bool]  # a rule's id; whether there is such a rule


class CommandIntake:
    """Handles messages on command topics. Only the main thread uses it."""

    def __init__(
        self,
        current: CurrentConfig,
        topics: Topics,
        link: LinkCheck,
        publish: Publish,
        submit: Callable[[AnyCommand], None],
        *,
        switch_rule: SwitchRule,
        budgets: Budgets | None = None,
    ) -> None:
        """Create it; `budgets` limit its log lines."""
        self._current = current
        self._topics = topics
        self._link = link
        self._publish = publish
        self._submit = submit
        self._switch_rule = switch_rule
        self._bounded = BoundedLog(_log, time.monotonic, budgets)
        self.stopping = False

    def receive(
        self, target: CommandTarget | CoverTarget | RuleTarget, received: Received, now: float
    ) -> None:
        """Pass one command on to its line, or refuse it: each one to a station gets one verdict."""
        if received.retain and not received.payload:
            return  # a client clears a retained command: this is not a command
        if isinstance(target, RuleTarget):
            self._take_switch(target.rule, received)
            return
        config = self._current.stations.get(target.station_id)
        if config is None:
            self._warn(target.station_id[:_SHOWN_CHARS])
            return
        objection = self._objection(received)
        try:
            command = parse_command(target, received, config, self._topics)
        except BadCommandError as error:
            objection = objection or (Reason(error.reason), error.detail)
            self._refuse(target, received, error, objection, now)
            return
        if objection is None:
            self._submit(command)
        else:
            self._refuse(target, received, command, objection, now)

    def _take_switch(self, rule: str, received: Received) -> None:
        """Switch a rule on or off; its state is the answer, and the log names a refusal."""
        on = _SWITCHED.get(received.payload)
        objection = self._objection(received)
        if objection is not None:
            refusal = ": ".join(objection)
        elif on is None:
            refusal = "the payload is neither ON nor OFF"
        elif not self._switch_rule(rule, on):
            refusal = "there is no such rule"
        else:
            return
        text = f"rule {rule[:_SHOWN_CHARS]!a} was not switched: {refusal}"
        self._bounded.tell(Cause.COMMAND, "rules", logging.WARNING, text)

    def _objection(self, received: Received) -> tuple[Reason, str] | None:
        if received.retain:
            return Reason.RETAINED, "commands are never published with the retain flag"
        # Judged at its arrival: pings that arrived before it are handled before it.
        if self._link.stale(received.at):
            return Reason.STALE_LINK, STALE_WORDS
        if self.stopping:
            return Reason.STOPPING, "the bridge is being stopped"
        return None

    def _refuse(
        self,
        target: CommandTarget | CoverTarget,
        received: Received,
        asked: AnyCommand | BadCommandError,
        objection: tuple[Reason, str],
        now: float,
    ) -> None:
        reason, detail = objection
        self._publish(
            Verdict(
                station_id=target.station_id,
                target=target.name,
                payload=asked.payload,
                status=Status.REFUSED,
                ms=max(0, round((now - received.at) * 1000)),
                reason=reason,
                id=asked.id,
                detail=detail,
                reply_to=reply_to(received, self._topics),
            )
        )

    def _warn(self, station_id: str) -> None:
        text = f"a command to unknown station {station_id!a}"
        self._bounded.tell(
            Cause.UNKNOWN_STATION, "", logging.WARNING, text, {"station": station_id}
        )
