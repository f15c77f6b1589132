"""`wisco2mqtt completion`, in real shells: what a person who presses TAB gets."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.one_panel import one_panel
from support.person_screen import PersonScreen

from bridge.cli.completion import whole_parser
from bridge.cli.main import COMMANDS

BIN = Path(sys.executable).parent
PROMPT = "ready>"
SHELLS = {
    "bash": (["bash", "--norc", "--noprofile", "-i"], "source {script}"),
    "fish": (
        [
            "fish",
            "--no-config",
            "--init-command",
            "function fish_prompt; echo -n 'ready>'; end",
            "-i",
        ],
        "source {script}",
    ),
    "zsh": (["zsh", "-f", "-i"], "fpath+={script.parent}; autoload -U compinit; compinit -u -D"),
}


@contextmanager
def at_a_shell(shell: str, directory: Path) -> Iterator[PersonScreen]:
    """An interactive shell in a directory with a configuration, its completion set up."""
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    script = directory / "functions" / "_wisco2mqtt"  # the name that zsh looks for
    script.parent.mkdir()
    command = (str(BIN / "wisco2mqtt"), "completion", shell)
    script.write_bytes(subprocess.run(command, check=True, capture_output=True).stdout)
    start, load = SHELLS[shell]
    path = f"{BIN}:/usr/bin:/bin"
    with PersonScreen(start, cwd=directory, PATH=path, PS1=PROMPT, HOME=str(directory)) as screen:
        screen.wait_for(PROMPT)
        screen.type(f"{load.format(script=script)}; echo load''ed\n")
        screen.wait_for("loaded")
        yield screen


@pytest.fixture(params=SHELLS, scope="module")
def started(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[PersonScreen]:
    """Each shell, on a panel with `garage` and `pumps`."""
    directory = tmp_path_factory.mktemp("home")
    with one_panel(directory), at_a_shell(request.param, directory) as screen:
        (directory / "garage.yaml").write_text("outputs: {}\n")
        (directory / "station.hex").write_text("")
        yield screen


@pytest.fixture
def shell(started: PersonScreen) -> PersonScreen:
    """Start the shell, with an empty screen and an empty line."""
    started.type("\x15\x0c")
    started.wait_for(lambda seen: seen.strip() == PROMPT)
    return started


@pytest.mark.parametrize(
    ("typed", "becomes"),
    [
        ("wisco2mqtt mon", "wisco2mqtt monitor "),
        ("wisco2mqtt scan --thor", "wisco2mqtt scan --thorough "),
        ("wisco2mqtt get --protocol modbus-r", "wisco2mqtt get --protocol modbus-rtu "),
        ("wisco2mqtt --log-level d", "wisco2mqtt --log-level debug "),
        ("wisco2mqtt eeprom res", "wisco2mqtt eeprom restore "),
        ("wisco2mqtt eeprom dump st", "wisco2mqtt eeprom dump station.hex "),
        ("wisco2mqtt check -c conf", "wisco2mqtt check -c config.yaml "),
        ("wisco2mqtt get -c config.yaml pu", "wisco2mqtt get -c config.yaml pumps "),
        ("wisco2mqtt send ga", "wisco2mqtt send garage "),
        ("wisco2mqtt send garage do/16/m", "wisco2mqtt send garage do/16/mode "),
        ("wisco2mqtt send garage do/3 TO", "wisco2mqtt send garage do/3 TOGGLE "),
    ],
)
def test_tab_completes_what_was_begun(shell: PersonScreen, typed: str, becomes: str) -> None:
    """Commands, options, their values, files, and the stations of the configuration."""
    shell.type(f"{typed}\t")
    # What was completed ends with a blank, so the next word stands apart from it.
    shell.wait_for(lambda seen: becomes.strip() in seen)
    shell.type("!")
    shell.wait_for(f"{becomes}!")


def test_tab_lists_the_commands(shell: PersonScreen) -> None:
    """All of them, where nothing was begun."""
    shell.type("wisco2mqtt \t\t")
    shell.wait_for(lambda seen: all(name in seen for name in COMMANDS))


def test_stations_of_no_configuration_are_none(tmp_path: Path) -> None:
    """TAB without a configuration prints no error: the command itself will report it."""
    gone = str(tmp_path / "gone.yaml")
    command = (str(BIN / "wisco2mqtt"), "completion", "stations", "-c", gone)
    done = subprocess.run(command, check=False, capture_output=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


def test_without_the_library_one_line_says_what_to_install() -> None:
    """The extra is not there: status 1."""
    script = (
        "import sys; sys.modules['shtab'] = None\n"
        "from bridge.cli.main import main\n"
        "sys.exit(main(['completion', 'bash']))"
    )
    done = subprocess.run([sys.executable, "-c", script], check=False, capture_output=True)
    assert (done.returncode, done.stdout) == (1, b"")
    assert done.stderr.startswith(b"wisco2mqtt: completion's library shtab is missing (extra `cli`")
    assert done.stderr.count(b"\n") == 1


def test_every_command_is_in_the_scripts_tree() -> None:
    """A command that is added is completed without anything more."""
    text = whole_parser().format_help()
    assert all(name in text for name in COMMANDS)
