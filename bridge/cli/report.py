"""`wisco2mqtt report`: all that helps those who help, in one file that `simulate --replay` reads.

The trace is its text; everything else stands before it in comments, which a replay passes over.
"""

import argparse
import json
import os
import platform
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TextIO

from bridge import __version__
from bridge.cli.frame.arguments import duration
from bridge.cli.frame.usage import UsageError
from bridge.cli.through_broker.ask_bridge import asked, line_named
from bridge.cli.through_broker.monitor_line import traced_line
from bridge.cli.views.monitor_record import TranscriptRecorder
from bridge.config.load import find_config, load_config
from bridge.config.schema import Config
from bridge.config.without_secrets import without_secrets
from bridge.errors import BridgeError
from bridge.files import MAX_FILE_BYTES, read_file

NAME = "report"
EXAMPLES = ("report report.txt --for 10s",)

_LOG_LINES = 500
_MARK = "# | "  # no line of it is one of the two that a replay reads


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare where it goes, and what it takes along."""
    parser.description = (
        "Writes the version, the configuration without its secrets, the bridge's diagnostics, and "
        "what passes on a line for a while. Add what `verify --json` printed, and the log. What "
        "the bridge does not tell is named, and left out. Look at the file before you send it."
    )
    add = parser.add_argument
    add("file", metavar="FILE", type=Path, help="a new file")
    add("--line", metavar="LINE", help="whose trace; default: the first line")
    add(
        "--for",
        dest="span",
        type=duration("60s"),
        default=60.0,
        metavar="TIME",
        help="default: 60s",
    )
    add("--verify", type=Path, metavar="JSON", help="what verify --json has printed")
    add("--log", type=Path, metavar="LOG", help="its last 500 lines; -: from standard input")


def run(args: argparse.Namespace) -> int:
    """Write the report."""
    path = find_config(args.config)
    config = load_config(path, os.environ)
    line = line_named(config, args.line) if args.line else config.lines[0]
    given = {name: _text(file) for name in ("verify", "log") if (file := getattr(args, name))}
    try:
        with args.file.open("x", encoding="utf-8") as file:
            _write(file, "program", _program())
            _write(file, "configuration", without_secrets(_text(path), str(path)).splitlines())
            _write(file, "diagnostics", [_diagnostics(config)])
            _write(file, "verify", given.get("verify", "not given").splitlines())
            _write(file, "log", given.get("log", "not given").splitlines()[-_LOG_LINES:])
            _trace(file, args, line.id)
    except FileExistsError:
        raise BridgeError(f"{args.file} is there already: name a new file") from None
    except OSError as error:
        raise BridgeError(f"{args.file} cannot be written: {error.strerror}") from error
    print(f"{args.file} is written: look at it before you send it", file=sys.stderr)
    return 0


def _program() -> Iterator[str]:
    yield f"wisco2mqtt {__version__}, Python {platform.python_version()}, {platform.platform()}"


def _write(file: TextIO, title: str, lines: Iterable[str]) -> None:
    file.write(f"{_MARK}--- {title} ---\n")
    file.writelines(f"{_MARK}{line}\n" for line in lines)


def _text(path: Path) -> str:
    try:
        data = sys.stdin.buffer.read(MAX_FILE_BYTES) if str(path) == "-" else read_file(path)
        return data.decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise UsageError(f"{path} cannot be read: {reason}") from None


def _diagnostics(config: Config) -> str:
    try:
        with asked(config.mqtt, "diagnostics", {}, purpose=NAME) as answers:
            *_, document = answers
    except BridgeError as error:
        return _left_out("diagnostics", error)
    plain = {key: value for key, value in document.items() if key != "final"}
    return json.dumps(plain, ensure_ascii=False)


def _trace(file: TextIO, args: argparse.Namespace, line: str) -> None:
    try:
        with traced_line(line, args.config, args.span) as source:
            recorder = TranscriptRecorder(file)
            recorder.begin(source.baud)
            for heard in source.heard(lambda: False):
                recorder.record(heard)
    except BridgeError as error:
        _write(file, "trace", [_left_out("the trace", error)])


def _left_out(what: str, error: BridgeError) -> str:
    text = f"{what} left out: {error}"
    print(text, file=sys.stderr)
    return text
