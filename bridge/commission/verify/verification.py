"""One verification of the modules of a line, from the first sample to the document of it."""

import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from bridge.commission.verify.assumptions import ASSUMPTIONS, Finding, FindingWord, not_tried
from bridge.commission.verify.line import VerifiedLine, WatchedLine
from bridge.commission.verify.output import NAMES, output_findings
from bridge.commission.verify.proposal import proposed
from bridge.commission.verify.questions import read_questions
from bridge.commission.verify.sampling import (
    Errors,
    Samples,
    sample,
    silence_before,
    timing_findings,
    upper_bound,
)
from bridge.commission.verify.talk import Talk
from bridge.config.schema import LineConfig
from bridge.model import ModuleType
from bridge.transport.timing import LineTiming

SAMPLES = 100
_PATIENCE_S = 0.3  # beyond what is a late reply by the settings: so that the latest show
_QUESTIONS = 140  # about as many exchanges as the questions take

Tell = Callable[[Mapping[str, Any]], None]


@dataclass(frozen=True, slots=True)
class Module:
    """One module to verify."""

    address: int
    model: ModuleType
    name: str


def modules_of(line: LineConfig, addresses: Collection[int]) -> list[Module]:
    """Return those configured modules of a line that have one of these addresses."""
    return [
        Module(config.address, config.model, config.id)
        for config in line.stations
        if config.address in addresses
    ]


def patient(line: LineConfig) -> LineTiming:
    """Return times that wait for each reply, however late."""
    timing = LineTiming.from_config(line)
    margin_s = timing.margin_s + line.late_window_s + _PATIENCE_S
    return replace(timing, fixed_timeout_s=None, margin_s=margin_s)


class Verification:
    """Asks the modules one after the other. Used once, by one thread.

    Args: `output` of the only module may be switched; None: reads alone.
    """

    def __init__(
        self,
        line: LineConfig,
        modules: Sequence[Module],
        samples: int = SAMPLES,
        output: int | None = None,
    ) -> None:
        self._line = line
        self._timing = LineTiming.from_config(line)
        self._modules = modules
        self._samples = samples
        self._output = output

    @property
    def total_s(self) -> float:
        """Return about what it takes while all modules answer."""
        chars = {True: 30, False: 16}["modbus" in self._line.protocol]
        each_s = self._timing.floor_s(chars // 2, chars // 2) + 0.01
        return len(self._modules) * (self._samples + _QUESTIONS) * each_s

    def run(self, line: VerifiedLine, tell: Tell) -> Mapping[str, Any]:
        """Verify all modules, and return the document.

        Raises:
            PortError: The port is gone.
            BridgeError: The line has no time for it any more.
        """
        stations, measured = [], []
        for place, module in enumerate(self._modules):
            steps = itertools.count()

            def step(
                place: int = place, steps: Iterator[int] = steps, name: str = module.name
            ) -> None:
                share = min(1.0, next(steps) / (self._samples + _QUESTIONS))
                done = round((place + share) / len(self._modules), 3)
                tell({"line": self._line.id, "progress": done, "at": name})

            protocol, baud = self._line.protocol, self._line.baud
            watched = WatchedLine(line, step)
            talk = Talk(watched, protocol, baud, module.address, module.model)
            samples = sample(talk, self._timing, self._samples)
            measured.append(samples)
            found = {one.id: one for one in self._findings(talk, samples)}
            stations.append(_station(module, samples, [found[name] for name in ASSUMPTIONS]))
        return self._document(stations, measured)

    def _findings(self, talk: Talk, samples: Samples) -> Iterator[Finding]:
        if samples.errors.asked == samples.errors.silent:
            yield from (not_tried(name, "the module does not answer") for name in ASSUMPTIONS)
            return
        yield from timing_findings(samples, self._timing, self._line.late_window_s)
        yield from read_questions(talk)
        yield silence_before(talk, self._timing, samples)
        if self._output is None:
            yield from (not_tried(name, "it would switch: give --output N") for name in NAMES)
        else:
            yield from output_findings(talk, self._output)

    def _document(self, stations: list[dict[str, Any]], measured: list[Samples]) -> dict[str, Any]:
        total = Errors()
        for samples in measured:
            total.add(samples.errors)
        return {
            "line": self._line.id,
            "port": self._line.port,
            "baud": self._line.baud,
            "protocol": self._line.protocol.value,
            "progress": 1.0,
            "stations": stations,
            "errors": errors_document(total),
            "settings": [asdict(one) for one in proposed(self._line, measured)],
        }


def errors_document(errors: Errors) -> dict[str, Any]:
    """Return counts by kind, and the error rate with its bound."""
    rate = errors.failed / errors.asked if errors.asked else 0.0
    bound = upper_bound(errors.failed, errors.asked)
    return {**asdict(errors), "rate": round(rate, 5), "rate_at_most": round(bound, 5)}


def fails(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return station and id of each assumption that differs, and that the bridge relies on."""
    return [
        (station["name"], finding["id"])
        for station in document["stations"]
        for finding in station["findings"]
        if finding["word"] == FindingWord.DIFFERS and ASSUMPTIONS[finding["id"]].relied
    ]


def unheard(document: Mapping[str, Any]) -> list[str]:
    """Return the modules that never answered."""
    return [
        station["name"]
        for station in document["stations"]
        if station["errors"]["silent"] == station["errors"]["asked"]
    ]


def _station(module: Module, samples: Samples, findings: list[Finding]) -> dict[str, Any]:
    return {
        "address": module.address,
        "name": module.name,
        "model": module.model.name,
        "findings": [asdict(one) for one in findings],
        "errors": errors_document(samples.errors),
        "turnaround_ms": {
            "p50": round(samples.quantile_s(0.5) * 1000, 2),
            "p99": round(samples.quantile_s(0.99) * 1000, 2),
            "longest": round(samples.longest_s * 1000, 2),
            "of": len(samples.begins_s),
        },
    }
