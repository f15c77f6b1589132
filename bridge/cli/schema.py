"""`wisco2mqtt schema`: the JSON Schema of the configuration, for editors."""

import argparse
import json
import os

from bridge.config.load import config_shape

NAME = "schema"
EXAMPLES = ("schema > wisco2mqtt.schema.json",)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Take no arguments but the common ones."""
    parser.description = (
        "Prints a JSON Schema with which an editor completes keys and marks mistakes while you "
        "type: a line `# yaml-language-server: $schema=FILE` at the top of the configuration names "
        "it. It is made from what reads the configuration. `check` sees more: what two places say "
        "together, and whether a time is in range."
    )


def run(args: argparse.Namespace) -> int:  # noqa: ARG001  # every command takes its arguments
    """Print it."""
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "The configuration of wisco2mqtt",
    }
    print(json.dumps({**head, **config_shape(os.environ)}, indent=2))
    return 0
