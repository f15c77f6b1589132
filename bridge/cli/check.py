"""`wisco2mqtt check`: every problem of the configuration at once, the poll plan, and a verdict."""

import argparse
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from bridge.cli.check_live import Trial, trials
from bridge.cli.views.rule_words import in_words
from bridge.config.advice import advice_on
from bridge.config.load import find_config, load_config
from bridge.config.schema import Config, RuleConfig
from bridge.errors import ConfigError, Problem
from bridge.line.forecast import Forecast, forecast, gestures_too_fast
from bridge.line.promptness import LinePromptness, Promptness
from bridge.line.rule_forecast import rule_forecast, rules_too_slow

NAME = "check"
EXAMPLES = (
    "check -c config.yaml",
    "check --json",
    "check --live",
)

_EX_CONFIG = 78


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what is tried, and how it is printed."""
    parser.description = (
        "Names every problem of the configuration as FILE:LINE:COL: message. A configuration "
        "without problems gets its poll plan: how long one round of each line takes, and how "
        "old a state of each station can get while everything answers: its inputs, and all of it; "
        "then the longest time until a change is published (an output that another master "
        "switched; an input, without its debounce time) and until the verdict on a command or on "
        "a scene (a command for each output of the station, at once; latches). Broker and network "
        "add theirs. "
        "A pulse on an input that is shorter than the bound of the inputs can be missed. Each rule "
        "is said in words, with the time within which it acts. A secret "
        "that cannot be read here is a remark: the service may read more than you. The last line "
        "says whether all is well."
    )
    parser.epilog = (
        "Exit status: 0 when the configuration is valid, 78 when it is not; with --live 1 when "
        "something does not answer."
    )
    parser.add_argument(
        "--live",
        action="store_true",
        help="try the broker, the ports and the stations too; it only reads",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> int:
    """Print the plan to stdout; problems are raised as ConfigError."""
    path = find_config(args.config)
    try:
        config = load_config(path, os.environ, secrets=False)
    except ConfigError as error:
        if not args.json:
            raise
        print(json.dumps(_refused(path, error.problems), ensure_ascii=False))
        return _EX_CONFIG
    plans = {line.id: forecast(line) for line in config.lines}
    remarks = [*_unread(path), *_advice(config, plans)]
    tried = trials(path, config) if args.live else None
    if args.json:
        return _print_document(path, config, plans, remarks, tried)
    for remark in remarks:
        print(f"warning: {remark}", file=sys.stderr)
    _print_plans(config, plans)
    return _print_verdict(path, config, remarks, tried)


def _unread(path: Path) -> list[str]:
    """Return the secrets that cannot be read here: they alone are what differs."""
    try:
        load_config(path, os.environ)
    except ConfigError as error:
        return [str(problem) for problem in error.problems]
    return []


def _advice(config: Config, plans: Mapping[str, Forecast]) -> Iterator[str]:
    yield from advice_on(config)
    for line in config.lines:
        yield from gestures_too_fast(line, plans[line.id])
    yield from rules_too_slow(config, plans)


def _print_plans(config: Config, plans: Mapping[str, Forecast]) -> None:
    for line in config.lines:
        plan = plans[line.id]
        prompt = LinePromptness(line, plan)
        seen = prompt.stations()
        print(f"line {line.id}: cycle {plan.cycle_s * 1000:.1f} ms")
        for station_config in line.stations:
            inputs_s = plan.inputs_s.get(station_config.id)
            inputs = "" if inputs_s is None else f" (inputs {inputs_s * 1000:.1f} ms)"
            model = station_config.model.name
            print(
                f"  station {station_config.id} (address {station_config.address}, {model}): "
                f"bound {plan.bound_s[station_config.id] * 1000:.1f} ms{inputs}: "
                + _in_words(seen[station_config.id])
            )
        if len(line.stations) > 1:
            print(f"  while stations are dead, however many: {_in_words(prompt.with_dead())}")
            print(f"  a scene on all stations of the line: {_shown(prompt.scene_s())}")
    for rule in config.rules:
        print(f"rule {rule.name}: {in_words(rule, rule_forecast(rule, config, plans))}")


def _in_words(seen: Promptness) -> str:
    changes = f"an output change is seen within {_shown(seen.output_s)}"
    if seen.input_s is not None:
        changes = (
            f"an input change is seen within {_shown(seen.input_s)}, "
            f"an output change within {_shown(seen.output_s)}"
        )
    return (
        f"{changes}, a command is done within {_shown(seen.command_s)}, "
        f"a scene within {_shown(seen.scene_s)}"
    )


def _shown(seconds: float) -> str:
    return f"{seconds * 1000:.0f} ms" if seconds < 1 else f"{seconds:.1f} s"


def _print_verdict(
    path: Path, config: Config, remarks: Sequence[str], tried: Iterator[Trial] | None
) -> int:
    failed = 0
    for trial in tried or ():
        print(trial, flush=True)
        failed += not trial.ok
    print(_verdict(path, config, remarks, failed))
    return 1 if failed else 0


def _verdict(path: Path, config: Config, remarks: Sequence[str], failed: int) -> str:
    stations = sum(len(line.stations) for line in config.lines)
    what = f"{_counted(len(config.lines), 'line')}, {_counted(stations, 'station')}"
    if failed:
        return f"{path} is valid ({what}), but not all is well: {failed} of what was tried failed"
    if remarks:
        return f"{path} is valid ({what}), with {_counted(len(remarks), 'warning')}"
    return f"{path} is valid ({what}): all is well"


def _counted(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"


def _print_document(
    path: Path,
    config: Config,
    plans: Mapping[str, Forecast],
    remarks: Sequence[str],
    tried: Iterator[Trial] | None,
) -> int:
    results = None if tried is None else [trial.document for trial in tried]
    ok = all(result["ok"] for result in results or ())
    document = {
        "file": str(path),
        "valid": True,
        "ok": ok,
        "problems": [],
        "warnings": list(remarks),
        "lines": [_line_document(config, plans, number) for number in range(len(config.lines))],
        "rules": [_rule_document(rule, config, plans) for rule in config.rules],
    }
    if results is not None:
        document["live"] = results
    print(json.dumps(document, ensure_ascii=False))
    return 0 if ok else 1


def _line_document(config: Config, plans: Mapping[str, Forecast], number: int) -> dict[str, Any]:
    line = config.lines[number]
    plan = plans[line.id]
    prompt = LinePromptness(line, plan)
    seen = prompt.stations()
    stations = [
        {
            "id": station_config.id,
            "address": station_config.address,
            "model": station_config.model.name,
            "bound_ms": _ms(plan.bound_s[station_config.id]),
            "inputs_ms": _ms(plan.inputs_s.get(station_config.id)),
            "outputs_ms": _ms(plan.outputs_s[station_config.id]),
            "seen_within": _promptness(seen[station_config.id]),
        }
        for station_config in line.stations
    ]
    return {
        "id": line.id,
        "port": line.port,
        "cycle_ms": _ms(plan.cycle_s),
        "scene_ms": _ms(prompt.scene_s()),
        "while_dead": _promptness(prompt.with_dead()),
        "stations": stations,
    }


def _promptness(seen: Promptness) -> dict[str, float | None]:
    return {
        "input_ms": _ms(seen.input_s),
        "output_ms": _ms(seen.output_s),
        "command_ms": _ms(seen.command_s),
        "scene_ms": _ms(seen.scene_s),
    }


def _rule_document(
    rule: RuleConfig, config: Config, plans: Mapping[str, Forecast]
) -> dict[str, Any]:
    times = rule_forecast(rule, config, plans)
    return {
        "id": rule.id,
        "name": rule.name,
        "text": in_words(rule, times),
        "answer_ms": _ms(times.lasts_s + times.answer_s),
    }


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds * 1000, 1)


def _refused(path: Path, problems: Sequence[Problem]) -> dict[str, Any]:
    listed = [
        {"file": one.file, "line": one.line, "column": one.column, "message": one.message}
        for one in problems
    ]
    return {"file": str(path), "valid": False, "ok": False, "problems": listed, "warnings": []}
