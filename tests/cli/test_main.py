"""The command line's frame: common options, errors and exit statuses."""

import argparse
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge import __version__
from bridge.cli import main as cli
from bridge.errors import ConfigError, PortError, Problem


class FakeCommand:
    """A command whose work is a function given by the test."""

    EXAMPLES = ("dip",)

    def __init__(self, work: Callable[[argparse.Namespace], int], name: str) -> None:
        self.work = work
        self.NAME = name

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Has one option of its own."""
        parser.add_argument("--depth", type=int, default=0)

    def run(self, args: argparse.Namespace) -> int:
        """Does what the test wants."""
        return self.work(args)


@pytest.fixture(autouse=True)
def _leave_logging_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cli, "configure_logging", lambda *_: None)


def use(monkeypatch: pytest.MonkeyPatch, work: Callable[[argparse.Namespace], int]) -> None:
    """Puts a fake in the place of every command."""
    monkeypatch.setattr(cli, "load_command", lambda name: FakeCommand(work, name))


def raising(error: BaseException) -> Callable[[argparse.Namespace], int]:
    """Gives a command's work that ends with this error."""

    def work(_args: argparse.Namespace) -> int:
        raise error

    return work


def arguments_seen(monkeypatch: pytest.MonkeyPatch, line: str) -> argparse.Namespace:
    """Runs a command line and gives what its command got to see."""
    seen: list[argparse.Namespace] = []

    def work(args: argparse.Namespace) -> int:
        seen.append(args)
        return 0

    use(monkeypatch, work)
    assert cli.main(line.split()) == 0
    return seen[0]


@pytest.mark.parametrize("name", cli.COMMANDS)
def test_every_command_of_the_table_has_a_module_of_its_name(name: str) -> None:
    """The table's names are those of the modules, so --help tells the truth."""
    assert name == cli.load_command(name).NAME


def test_every_command_module_stands_in_the_table() -> None:
    """Every module with a NAME is in the table of commands."""
    folder = Path(cli.__file__).parent
    with_name = {path.stem for path in folder.glob("*.py") if "\nNAME = " in path.read_text()}
    assert with_name == set(cli.COMMANDS)


def test_help_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    """`--help` shows each command with what it does."""
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--help"])
    text = capsys.readouterr().out
    for name, does in cli.COMMANDS.items():
        assert name in text
        assert does in text


def test_help_imports_no_command() -> None:
    """`--help` imports no command, which keeps the start fast."""
    script = (
        "import sys\nfrom bridge.cli.main import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "assert not {'paho', 'serial', 'yaml', 'bridge.commission.dip'} & set(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, timeout=30)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    """`--version` prints name and version."""
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--version"])
    assert capsys.readouterr().out == f"wisco2mqtt {__version__}\n"


@pytest.mark.parametrize(
    "arguments",
    [
        "-c a.yaml --log-level debug dip --depth 3",
        "dip -c a.yaml --log-level debug --depth 3",
        "dip --depth 3 --config=a.yaml --log-level=debug",
        "--config a.yaml dip --depth 3 --log-level debug",
        "-c b.yaml --log-level error dip -c a.yaml --log-level debug --depth 3",
    ],
)
def test_common_options_stand_before_or_after_the_command(
    arguments: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Either place will do, and the later one wins."""
    assert vars(arguments_seen(monkeypatch, arguments)) == {
        "config": Path("a.yaml"),
        "log_level": "debug",
        "depth": 3,
    }


def test_no_common_options_leave_their_defaults(monkeypatch: pytest.MonkeyPatch) -> None:
    """No file was named, and the log tells what matters."""
    seen = vars(arguments_seen(monkeypatch, "dip"))
    assert seen == {"config": None, "log_level": "info", "depth": 0}


def test_the_status_of_the_command_is_the_exit_status(monkeypatch: pytest.MonkeyPatch) -> None:
    """The return value of a command is the exit status."""
    use(monkeypatch, lambda _args: 1)
    assert cli.main(["dip"]) == 1


def test_a_wrong_configuration_shows_every_problem(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each problem is a line FILE:LINE:COL: message on stderr, and the status is 78."""
    problems = [Problem("c.yaml", 3, 5, "no such key"), Problem("c.yaml", 9, 1, "twice")]
    use(monkeypatch, raising(ConfigError(problems)))
    assert cli.main(["dip"]) == 78
    captured = capsys.readouterr()
    assert captured.err == "c.yaml:3:5: no such key\nc.yaml:9:1: twice\n"
    assert captured.out == ""


def test_another_error_of_ours_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The work failed: one line says so, and the status is 1."""
    use(monkeypatch, raising(PortError("/dev/ttyUSB7: no such port")))
    assert cli.main(["dip"]) == 1
    assert capsys.readouterr().err == "wisco2mqtt: /dev/ttyUSB7: no such port\n"


def test_a_bug_shows_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    """An unexpected exception shows its traceback, not a message about wrong usage."""
    use(monkeypatch, raising(ZeroDivisionError("a bug")))
    with pytest.raises(ZeroDivisionError):
        cli.main(["dip"])


def test_ctrl_c_is_a_fine_end_of_what_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that runs until it is told to stop ends with 0, and in silence."""
    use(monkeypatch, raising(KeyboardInterrupt()))
    assert cli.main(["watch"]) == 0


def test_ctrl_c_before_the_end_is_130(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C exits with 130 for a command that was interrupted before its end."""
    use(monkeypatch, raising(KeyboardInterrupt()))
    assert cli.main(["dip"]) == 130
    assert capsys.readouterr().err == "wisco2mqtt dip: interrupted before it was done\n"


def test_a_reader_who_left_is_no_error() -> None:
    """`wisco2mqtt ... | head` prints neither a traceback nor the interpreter's own complaint."""
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, "wb") as stdout:
        done = subprocess.run(
            [sys.executable, "-m", "bridge", "dip", "--station", "1"],
            check=False,
            stdout=stdout,
            stderr=subprocess.PIPE,
            timeout=30,
        )
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize("line", ["help send", "-c config.yaml help send"])
def test_help_of_a_command_is_its_help(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Wherever the common options stand."""
    with pytest.raises(SystemExit) as ended:
        cli.main(line.split())
    assert ended.value.code == 0
    assert capsys.readouterr().out.startswith("usage: wisco2mqtt send STATION TARGET VALUE")
