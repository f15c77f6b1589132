"""Decides which commands go to a line. Time is an argument (`bridge.clock.boot_s`)."""

from collections import OrderedDict

from bridge.config.schema import StationConfig
from bridge.model import AnyCommand, Command, Reason, Setting, SettingCommand, bits_of

ID_MEMORY_S = 60.0
_MOST_IDS = 50_000  # limits the memory in a flood: the oldest ids are forgotten first


class SeenIds:
    """Remembers the ids of commands for 60 s, to recognise duplicates (docs/failures.md A4)."""

    def __init__(self) -> None:
        self._seen: OrderedDict[str | int, float] = OrderedDict()

    def is_repeat(self, command_id: str | int, now: float) -> bool:
        """Return whether this id was seen in the last 60 s; else remember it."""
        while self._seen:
            oldest, at = next(iter(self._seen.items()))
            if now - at < ID_MEMORY_S and len(self._seen) < _MOST_IDS:
                break
            del self._seen[oldest]
        if command_id in self._seen:
            return True
        self._seen[command_id] = now
        return False


class RateLimit:
    """A bucket of commands that fills at a steady rate and holds those of one second."""

    def __init__(self, per_second: float, now: float) -> None:
        self._per_second = per_second
        self._most = max(per_second, 1.0)
        self._left = self._most
        self._at = now

    def admits(self, now: float) -> bool:
        """Take one command from the bucket; return False if it is empty."""
        self._left = min(self._most, self._left + (now - self._at) * self._per_second)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


class StationGate:
    """The rules that decide whether a command may go to one station.

    Attributes:
        online: Whether the module is reachable.
        wrong_model: Whether another model than configured answers.
        pulse: Outputs that are declared or read as pulses: TOGGLE is refused for them.
        pressable: Outputs that go OFF by themselves: as read, or as declared while nothing was
        read. An output that is declared a pulse but is a latch would stay ON after a PRESS.
    """

    def __init__(self, config: StationConfig, now: float) -> None:
        self.online = False
        self.wrong_model = False
        self._declared_pulse = bits_of(o.channel for o in config.outputs if o.mode == "pulse")
        self.pulse = self._declared_pulse
        self.pressable = self._declared_pulse
        self._read_only = config.read_only_outputs
        self._declared = {
            Setting.MODE: bits_of(o.channel for o in config.outputs if o.mode is not None),
            Setting.HOLD: bits_of(o.channel for o in config.outputs if o.hold_s is not None),
        }
        self._covers = config.cover_outputs
        self._maybe_pulse = -1  # nothing was read yet: any output may be one
        self._rate = RateLimit(config.rate_limit, now)

    def read_pulse(self, pulse: int | None) -> None:
        """Use the modes that the module has; None: they could not be read."""
        self.pulse = self._declared_pulse | (pulse or 0)
        self.pressable = self._declared_pulse if pulse is None else pulse
        self._maybe_pulse = -1 if pulse is None else self.pulse

    def objection(self, command: AnyCommand, now: float) -> Reason | None:
        """Return why `command` may not go to the line, or None.

        A setting that the configuration declares is refused: a command would hide the difference to
        the declaration. The outputs of a cover are switched ON only by commands to the cover; OFF
        stops the motor and is allowed.
        """
        if command.mask & self._locked(command):
            return Reason.READ_ONLY
        if self.wrong_model:
            return Reason.WRONG_MODEL
        if not self.online:
            return Reason.OFFLINE
        # A rule is limited by the reads that fire it, and floods of others do not hold it up.
        is_limited = command.by is None and not self._is_absolute(command)
        if is_limited and not self._rate.admits(now):
            return Reason.RATE_LIMITED
        return None

    def advice(self, command: AnyCommand, reason: Reason) -> str | None:
        """Return advice on a refusal, if its reason does not say enough."""
        if reason is Reason.READ_ONLY and command.mask & self._locked(command) & self._covers:
            return "an output of a cover: command the cover, or switch the output OFF to stop it"
        return None

    def _is_absolute(self, command: AnyCommand) -> bool:
        """Return whether it only says what latches are to be, or OFF.

        No limit is needed: of those that wait the line keeps the newest for each output, and
        without the newest a relay would stay as it was.
        """
        if not isinstance(command, Command) or command.word is not None:
            return False
        return not command.values & self._maybe_pulse

    def _locked(self, command: AnyCommand) -> int:
        """Return the outputs that a command of this kind may not name."""
        if isinstance(command, SettingCommand):
            return self._read_only | self._declared[command.setting] | self._covers
        if isinstance(command, Command):
            # TOGGLE has no values: it may switch ON.
            maybe_on = command.values if command.word is None else command.mask
            return self._read_only | self._covers & maybe_on
        return self._read_only
