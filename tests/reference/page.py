"""The text of a page, from what a command declares to argparse."""

import argparse
from collections.abc import Iterable
from textwrap import fill

from bridge.cli.frame.usage import actions_of
from bridge.cli.main import COMMANDS, PROG, CommandModule, command_parser, load_command

_COLUMNS = 118
_MADE = "<!-- Made by `make docs` from what `--help` prints: change it in bridge/cli/. -->"


def pages() -> dict[str, str]:
    """Every page by its file's name: one a command, and the list of them."""
    commands = {name: load_command(name) for name in COMMANDS}
    return {"README.md": _index(), **{f"{n}.md": page(command) for n, command in commands.items()}}


def page(command: CommandModule) -> str:
    """The page of one command."""
    parser = command_parser(command)
    synopsis = (parser.usage or "").replace("%(prog)s", parser.prog)
    notes = (parser.epilog or "").split("\n\n")[:-1]  # the last one is the examples
    parts = [
        _MADE,
        f"# `{parser.prog}`",
        fill(parser.description or "", _COLUMNS),
        f"```\n{synopsis}\n```",
        *_tables(parser),
        *(note if "\n" in note else fill(note, _COLUMNS) for note in notes),
        "For example:",
        "```sh\n" + "\n".join(f"{PROG} {line}" for line in command.EXAMPLES) + "\n```",
    ]
    return "\n\n".join(parts) + "\n"


def _index() -> str:
    rows = [f"| [`{PROG} {name}`]({name}.md) | {text} |" for name, text in COMMANDS.items()]
    return "\n\n".join([_MADE, "# Commands", "\n".join(["| | |", "|---|---|", *rows])]) + "\n"


def _tables(parser: argparse.ArgumentParser) -> list[str]:
    actions = [action for action in actions_of(parser) if action.help != argparse.SUPPRESS]
    words = [action for action in actions if not action.option_strings]
    options = [action for action in actions if action.option_strings]
    tables = [("argument", words), ("option", options)]
    return [_table(title, rows) for title, rows in tables if rows]


def _table(title: str, actions: Iterable[argparse.Action]) -> str:
    rows = [f"| {_name(action)} | {_escaped(action.help or '')} |" for action in actions]
    return "\n".join([f"| {title} | |", "|---|---|", *rows])


def _name(action: argparse.Action) -> str:
    value = action.metavar or "{" + ",".join(map(str, action.choices or ())) + "}"
    if not action.option_strings:
        return _code(str(value))
    takes = f" {value}" if action.nargs != 0 else ""
    return ", ".join(_code(f"{option}{takes}") for option in action.option_strings)


def _code(text: str) -> str:
    return f"`{_escaped(text)}`"


def _escaped(text: str) -> str:
    return text.replace("%%", "%").replace("|", "\\|")
