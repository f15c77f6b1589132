"""Within what time something is seen or done, in the plain words of `check`.

Pure. Times are in seconds, on the line alone: the broker and the network add theirs.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from bridge.config.schema import LineConfig, StationConfig
from bridge.drivers import driver_for, settings_driver_for
from bridge.drivers.driver import Driver
from bridge.line.forecast import Forecast
from bridge.line.inbox import BURST_S
from bridge.line.plan.plan import VAIN_SHARE
from bridge.protocol.request import Request
from bridge.transport.timing import LineTiming


@dataclass(frozen=True, slots=True)
class Promptness:
    """The longest times of one station, or of the slowest one.

    Attributes:
        input_s: Until a change of an input is published; None: it has none. A debounce time is not
            included.
        output_s: Until a change of an output by another master is published.
        command_s: Until the verdict on a command for a latch, if no other waits.
        scene_s: Until the last verdict on commands for all its outputs, given at once.
    """

    input_s: float | None
    output_s: float
    command_s: float
    scene_s: float


class LinePromptness:
    """The times of one line."""

    def __init__(self, line: LineConfig, plan: Forecast) -> None:
        self._line = line
        self._plan = plan
        self._exchanges = {config.id: _Exchanges(line, config) for config in line.stations}

    def stations(self) -> Mapping[str, Promptness]:
        """Return the times of each station by its id, while all answer."""
        return {config.id: self._of(config) for config in self._line.stations}

    def scene_s(self) -> float:
        """Return the time until the last verdict on commands for all outputs of the line."""
        exchanges = self._exchanges.values()
        scene_s = self._longest_read_s() + max(one.command_s for one in exchanges)
        scene_s += sum(one.scene_s for one in exchanges)
        return scene_s + max(0.0, scene_s - BURST_S)  # half of the time is left to the reads

    def with_dead(self) -> Promptness:
        """Return the times of the slowest station while modules are dead, however many.

        They are offline, so all that is asked of them are the probes.
        """
        each = self.stations().values()
        inputs = [one.input_s for one in each if one.input_s is not None]
        return Promptness(
            self._read_late_s(max(inputs)) if inputs else None,
            self._read_late_s(max(one.output_s for one in each)),
            max(one.command_s for one in each) + self._wait_s(),
            max(one.scene_s for one in each) + self._wait_s(),
        )

    def _of(self, config: StationConfig) -> Promptness:
        own = self._exchanges[config.id]
        input_s = self._plan.inputs_s.get(config.id)
        wait_s = self._longest_read_s()
        return Promptness(
            None if input_s is None else input_s + own.again_s,
            self._plan.outputs_s[config.id] + own.again_s,
            wait_s + own.command_s,
            wait_s + own.command_s + own.scene_s,  # the first of them may go alone
        )

    def _longest_read_s(self) -> float:
        return max(one.longest_read_s for one in self._exchanges.values())

    # --- while modules are dead ---

    def _read_late_s(self, seconds: float) -> float:
        """Return by when a read that takes so long is made, with the probes in this time."""
        probes = 1 + int(seconds * VAIN_SHARE / self._wait_s())
        return seconds + probes * (self._wait_s() + self._slower_s())

    def _wait_s(self) -> float:
        """Return for how long one probe in vain keeps all others waiting."""
        time_out_s = max(one.time_out_s for one in self._exchanges.values())
        return time_out_s + (0.0 if self._reads_go_on() else self._late_window_s())

    def _slower_s(self) -> float:
        """Return the time that reads lose while they are made in longer frames."""
        slowness = max(one.slowness for one in self._exchanges.values())
        return self._late_window_s() * slowness if self._reads_go_on() else 0.0

    def _late_window_s(self) -> float:
        protected = all(one.reader.protected for one in self._exchanges.values())
        return 0.0 if protected else self._line.late_window_s

    def _reads_go_on(self) -> bool:
        return all(one.writer.protected for one in self._exchanges.values())


class _Exchanges:
    """The times of the exchanges with one module."""

    def __init__(self, line: LineConfig, config: StationConfig) -> None:
        self.reader: Driver = driver_for(line.protocol, config.address, config.model)
        self._settings = settings_driver_for(line, config)
        self.writer: Driver = self._settings or self.reader
        self._timing = LineTiming.from_config(line)
        self._outputs = (1 << config.model.outputs) - 1

    @property
    def longest_read_s(self) -> float:
        """Return the time of its longest read: a command waits for that."""
        settings = () if self._settings is None else (self._settings.read_settings,)
        return max(map(self._s, (*self._reads(self.reader), *settings)))

    @property
    def again_s(self) -> float:
        """Return the time of the second read that a change needs."""
        return 0.0 if self.reader.protected else max(map(self._s, self._reads(self.reader)))

    @property
    def command_s(self) -> float:
        """Return the time of a write of one output and of the read after it."""
        return self._written_s(1)

    @property
    def scene_s(self) -> float:
        """Return the time of a write of all outputs and of the read after it."""
        return self._written_s(self._outputs)

    @property
    def time_out_s(self) -> float:
        """Return the time of a contact without an answer."""
        return max(
            self._timing.timeout_s(len(one.read_inputs.frame), one.read_inputs.reply_chars)
            for one in (self.reader, self.writer)
        )

    @property
    def slowness(self) -> float:
        """Return the part of the time that reads lose if they are made as the writes are."""
        usual = self._s(self.reader.read_outputs)
        return 1 - usual / self._s(self.writer.read_outputs)

    def _written_s(self, outputs: int) -> float:
        read_s = self._s(self.writer.read_outputs)
        reads = 1 if self.writer.protected else 2
        return self._s(self.writer.write_outputs(outputs, outputs, 0)) + reads * read_s

    def _reads(self, driver: Driver) -> Iterator[Request[int]]:
        yield driver.read_outputs
        if driver.module.inputs:
            yield driver.read_inputs

    def _s(self, request: Request[object]) -> float:
        return self._timing.floor_s(len(request.frame), request.reply_chars)
