"""A line worker that is judged: was what it published ever true?"""

import random
from collections import deque

from support.bus_worker import BusWorker

from bridge.config.schema import LineConfig
from bridge.model import DIO100, LineEvent, ValuesChanged

CHANGE_EVERY_S = 3.0
REMEMBERED_S = 10.0  # longer than a change takes to be published, shorter than to the one before


class JudgedWorker(BusWorker):
    """Compares what is published with what the modules were like lately.

    Attributes:
        false: How often a published value had not been true.
        told: How often values were published.
        reads: How many exchanges there were.
    """

    def __init__(
        self, config: LineConfig, chance: random.Random, *, wisco_only: bool = False
    ) -> None:
        super().__init__(config, wisco_only=wisco_only)
        self.false = 0
        self.told = 0
        self.reads = 0
        self._chance = chance
        self._truth: dict[str, deque[tuple[float, int, int]]] = {}
        self._told: dict[str, tuple[int, int]] = {}
        for address, module in self.line.modules.items():
            self._truth[f"s{address}"] = deque([(self.line.now, module.inputs, module.outputs)])

    def change(self) -> None:
        """One channel of one module turns over; each module is left alone for a while."""
        self.reads += len(self.line.wire)
        self.line.wire.clear()
        station_id, truth = next(iter(self._truth.items()))
        self._truth[station_id] = self._truth.pop(station_id)  # the one that is next in turn
        module = self.line.modules[int(station_id[1:])]
        module.toggle_input(self._chance.randint(1, DIO100.inputs))
        output = self._chance.randint(1, DIO100.outputs)
        module.set_output(output, not module.outputs >> (output - 1) & 1)
        truth.append((self.line.now, module.inputs, module.outputs))
        while len(truth) > 1 and truth[1][0] < self.line.now - REMEMBERED_S:
            truth.popleft()
        self.line.at(self.line.now + CHANGE_EVERY_S, self.change)

    def report(self, event: LineEvent) -> None:
        """See `VirtualWorker`."""
        if not isinstance(event, ValuesChanged):
            return
        self.told += 1
        told = (event.inputs, event.outputs)
        before = self._told.get(event.station_id, (None, None))
        self._told[event.station_id] = told
        for which in (0, 1):
            true = {each[which + 1] for each in self._truth[event.station_id]}
            self.false += told[which] != before[which] and told[which] not in true
