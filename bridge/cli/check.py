"""`wisco2mqtt check`: prints every problem of the configuration, or else the poll plan."""

import argparse
import os
import sys

from bridge.config.advice import advice_on
from bridge.config.load import find_config, load_config
from bridge.line.forecast import forecast, gestures_too_fast

NAME = "check"
HELP = "check the configuration and print the poll plan"
EXAMPLES = ("check -c config.yaml",)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Take no arguments but the common ones."""
    parser.description = (
        "Names every problem of the configuration as FILE:LINE:COL: message. A configuration "
        "without problems gets its poll plan: how long one round of each line takes, and how "
        "old a state of each station can get while everything answers: its inputs, and all of it. "
        "A pulse on an input that is shorter than the bound of the inputs can be missed."
    )


def run(args: argparse.Namespace) -> int:
    """Print the plan to stdout; problems are raised as ConfigError."""
    config = load_config(find_config(args.config), os.environ)
    for advice in advice_on(config):
        print(f"warning: {advice}", file=sys.stderr)
    for line in config.lines:
        plan = forecast(line)
        for advice in gestures_too_fast(line, plan):
            print(f"warning: {advice}", file=sys.stderr)
        print(f"line {line.id}: cycle {plan.cycle_s * 1000:.1f} ms")
        for station in line.stations:
            inputs_s = plan.inputs_s.get(station.id)
            inputs = "" if inputs_s is None else f" (inputs {inputs_s * 1000:.1f} ms)"
            print(
                f"  station {station.id} (address {station.address}, {station.model.name}): "
                f"bound {plan.bound_s[station.id] * 1000:.1f} ms{inputs}"
            )
    return 0
