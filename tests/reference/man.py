"""Man pages, from what a command declares to argparse, as its page in docs/commands is."""

import argparse
from collections.abc import Iterable

from bridge.cli.frame.usage import actions_of
from bridge.cli.main import COMMANDS, PROG, CommandModule, command_parser, load_command

_EXITS = (
    ("0", "It is done."),
    ("1", "It failed."),
    ("2", "Wrong usage."),
    ("78", "The configuration is wrong or missing."),
    ("130", "It was interrupted before its end."),
)


def man_pages() -> dict[str, str]:
    """Every page by its file's name: one a command, and the one that lists them."""
    pages = {f"{PROG}-{name}.1": man_page(load_command(name)) for name in COMMANDS}
    return {f"{PROG}.1": _index(), **pages}


def man_page(command: CommandModule) -> str:
    """The page of one command."""
    parser = command_parser(command)
    name = f"{PROG}-{command.NAME}"
    notes = (parser.epilog or "").split("\n\n")[:-1]  # the last one is the examples
    synopsis = (parser.usage or "").replace("%(prog)s", parser.prog)
    parts = [
        *_head(name, COMMANDS[command.NAME]),
        ".SH SYNOPSIS",
        _text(synopsis),
        ".SH DESCRIPTION",
        _text(parser.description or ""),
        *(f".PP\n{_text(note)}" for note in notes),
        ".SH OPTIONS",
        *map(_option, _listed(parser)),
        ".SH EXAMPLES",
        *(f".PP\n.nf\n{_text(f'{PROG} {line}')}\n.fi" for line in command.EXAMPLES),
        *_exits(),
        ".SH SEE ALSO",
        f".BR {PROG} (1)",
    ]
    return "\n".join(parts) + "\n"


def _index() -> str:
    rows = (f".TP\n.BR {PROG}\\-{name} (1)\n{_text(text)}" for name, text in COMMANDS.items())
    parts = [
        *_head(PROG, "Wisco DIO100 and DO100 modules on RS485, on MQTT and in Home Assistant"),
        ".SH SYNOPSIS",
        _text(f"{PROG} [-c FILE] [--log-level LEVEL] COMMAND [options]"),
        ".SH COMMANDS",
        *rows,
        *_exits(),
    ]
    return "\n".join(parts) + "\n"


def _head(name: str, text: str) -> list[str]:
    made = '.\\" Made by `make docs` from what --help prints.'
    return [made, f".TH {name.upper()} 1", ".SH NAME", f"{_text(name)} \\- {_text(text)}"]


def _exits() -> list[str]:
    return [".SH EXIT STATUS", *(f".TP\n.B {code}\n{text}" for code, text in _EXITS)]


def _listed(parser: argparse.ArgumentParser) -> Iterable[argparse.Action]:
    return (action for action in actions_of(parser) if action.help != argparse.SUPPRESS)


def _option(action: argparse.Action) -> str:
    value = action.metavar or "{" + ",".join(map(str, action.choices or ())) + "}"
    names = ", ".join(action.option_strings) or str(value)
    takes = f" {value}" if action.option_strings and action.nargs != 0 else ""
    return f".TP\n.B {_text(names + takes)}\n{_text((action.help or '').replace('%%', '%'))}"


def _text(text: str) -> str:
    """What roff takes as it stands: no line begins with a dot or a quote."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-")
    return "\n".join(
        f"\\&{line}" if line[:1] in {".", "'"} else line for line in escaped.split("\n")
    )
