"""The frame of the command line: finds the command; turns errors into lines and exit statuses."""

import argparse
import os
import sys
from collections.abc import Iterable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from bridge import __version__
from bridge.cli.frame.interrupt import EX_INTERRUPTED, StoppedError, sigterm_interrupts
from bridge.cli.frame.logs import LEVELS, configure_logging
from bridge.cli.frame.usage import EX_USAGE, OneLineParser, UsageError, synopsis_of
from bridge.errors import BridgeError, ConfigError

PROG = "wisco2mqtt"

EX_OK = 0
EX_FAILED = 1
EX_CONFIG = 78  # sysexits.h; the unit has RestartPreventExitStatus=78

_HELP = "help"

# For these commands a stop is the normal end; for the others it is an interruption.
_GO_ON = frozenset({"run", "demo", "watch", "monitor", "simulate"})

# The texts are here so that --help imports no command.
COMMANDS = {
    "run": "run the bridge",
    "check": "check the configuration and print the poll plan",
    "simulate": "simulate modules on a pseudo-terminal or a TCP port",
    "demo": "show everything at work: simulated modules, a broker, the bridge",
    "watch": "print the state topics live, through the broker",
    "send": "send a command through the broker and print its verdict",
    "get": "read one module on its port, without a broker",
    "set": "switch or set one module on its port, without a broker",
    "scan": "find the modules on a port, and write a configuration of them",
    "verify": "measure what modules do against what is assumed, and propose the line's settings",
    "settings": "modes and hold times of one module as YAML: show, diff, apply",
    "eeprom": "the EEPROM of one module: dump, diff, restore",
    "backup": "save configuration, counts and what every module holds, in one file",
    "restore": "bring back what a backup has: show what differs, ask, write only that",
    "monitor": "show what passes on a line, decoded, and record it",
    "purge": "clear what is retained on the broker of this base topic, after a question",
    "report": "gather what helps those who help, without secrets, in one file",
    "dip": "show the DIP switches for a station, baud rate and protocol, and back",
    "schema": "print the JSON Schema of the configuration, for editors",
    "completion": "print a script with which a shell completes command lines",
}


class CommandModule(Protocol):
    """The interface of a module bridge/cli/COMMAND.py."""

    NAME: str
    EXAMPLES: Sequence[str]  # command lines without the program's name; tests run them

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the command's own arguments."""

    def run(self, args: argparse.Namespace) -> int:
        """Run the command; return its exit status."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line; return its exit status. Wrong usage and --help end the process."""
    with sigterm_interrupts():
        try:
            command, args = parse_arguments(argv)
        except KeyboardInterrupt:
            return EX_INTERRUPTED  # before anything was done
        configure_logging(args.log_level, os.environ)
        return _run(command, args)


def parse_arguments(argv: Sequence[str] | None) -> tuple[CommandModule, argparse.Namespace]:
    """Return the command of a command line, and its arguments."""
    first = _frame().parse_args(argv)
    if first.command == _HELP:  # `help COMMAND` is `COMMAND --help`, and `help` alone is `--help`
        first = _frame().parse_args([*first.rest[:1], "--help"])
    command = load_command(first.command)
    return command, _parse_command(command, first)


def load_command(name: str) -> CommandModule:
    """Import only the command that is called, which keeps the start fast."""
    return cast("CommandModule", import_module(f"bridge.cli.{name}"))


def command_parser(command: CommandModule) -> argparse.ArgumentParser:
    """Return a parser for the arguments after a command's name."""
    parser = OneLineParser(prog=f"{PROG} {command.NAME}")
    add_command(command, parser)
    return parser


def add_command(command: CommandModule, parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of a command and the common ones; set its synopsis and examples."""
    parser.description = COMMANDS[command.NAME]
    command.add_arguments(parser)
    parser.usage = parser.usage or synopsis_of(parser)
    examples = "\n".join(f"  {PROG} {line}" for line in command.EXAMPLES)
    parser.epilog = "\n\n".join(filter(None, (parser.epilog, f"examples:\n{examples}")))
    add_common(parser)


def _frame() -> argparse.ArgumentParser:
    texts = [f"  {name:<12}{text}" for name, text in COMMANDS.items()]
    parser = OneLineParser(
        prog=PROG,
        usage=f"{PROG} [-c FILE] [--log-level LEVEL] COMMAND [options]",
        description="Wisco DIO100 and DO100 modules on RS485, on MQTT and in Home Assistant.",
        epilog="commands:\n" + "\n".join(texts) + f"\n\n{PROG} help COMMAND tells the rest.",
    )
    parser.add_argument("--version", action="version", version=f"{PROG} {__version__}")
    add_common(parser)
    parser.set_defaults(config=None, log_level="info")
    parser.add_argument(
        "command", choices=(*COMMANDS, _HELP), metavar="COMMAND", help="one of those below"
    )
    rest = parser.add_argument("rest", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    rest.required = False  # it may be empty, and argparse would name it as missing beside COMMAND
    return parser


def add_common(parser: argparse.ArgumentParser) -> None:
    """Declare the options of every command."""
    # Accepted before and after the command: without SUPPRESS the defaults of the later parser would
    # overwrite the values of the earlier one.
    parser.add_argument(
        "-c",
        "--config",
        metavar="FILE",
        type=Path,
        default=argparse.SUPPRESS,
        help="the configuration (default: config.yaml here, then /etc/wisco2mqtt/config.yaml)",
    )
    parser.add_argument(
        "--log-level",
        choices=LEVELS,
        default=argparse.SUPPRESS,
        help="what the log on stderr holds (default: info)",
    )


def _parse_command(command: CommandModule, first: argparse.Namespace) -> argparse.Namespace:
    parser = command_parser(command)
    given = argparse.Namespace(config=first.config, log_level=first.log_level)
    # Words may come before, between and after the flags.
    return parser.parse_intermixed_args(first.rest, given)


def _run(command: CommandModule, args: argparse.Namespace) -> int:
    try:
        status = command.run(args)
        sys.stdout.flush()  # so that a closed pipe is noticed here and not at exit
    except BridgeError as error:
        return _failed(command, error)
    except BrokenPipeError:
        _silence_stdout()
        return EX_OK
    except KeyboardInterrupt:
        return _interrupted(command, args)
    return status


def _failed(command: CommandModule, error: BridgeError) -> int:
    if isinstance(error, ConfigError):
        _complain(str(problem) for problem in error.problems)
        return EX_CONFIG
    if isinstance(error, UsageError):
        _complain([f"{PROG} {command.NAME}: {error} (see {PROG} {command.NAME} --help)"])
        return EX_USAGE
    _complain([f"{PROG}: {error}"])
    return EX_INTERRUPTED if isinstance(error, StoppedError) else EX_FAILED


def _interrupted(command: CommandModule, args: argparse.Namespace) -> int:
    # docs/commands/README.md, exit status: a command that runs until it is stopped ends normally
    # here.
    if command.NAME in _GO_ON or getattr(args, "watch", False):
        return EX_OK
    _complain([f"{PROG} {command.NAME}: interrupted before it was done"])
    return EX_INTERRUPTED


def _complain(lines: Iterable[str]) -> None:
    for line in lines:
        print(line, file=sys.stderr)


def _silence_stdout() -> None:
    # The interpreter flushes stdout again at exit and would report the same closed pipe.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
