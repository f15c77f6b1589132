"""Finding and loading the file: defaults, what cannot be read, and what is no configuration."""

import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.config_file import HOME, file_with, load_text, problems_of

from bridge.config import load
from bridge.config.load import find_config, load_config
from bridge.config.schema import (
    HomeAssistantConfig,
    InputConfig,
    LineConfig,
    MqttConfig,
    OutputConfig,
    StationConfig,
)
from bridge.errors import ConfigError, Problem
from bridge.model import DIO100, DO100, LineProtocol, Writes


def _only_problem(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load_config(path, {"HOME": HOME})
    return str(caught.value)


def test_the_shortest_file_gets_every_default(tmp_path: Path) -> None:
    """A line and a station are enough; every channel of the model exists."""
    config = load_text(tmp_path, file_with())

    assert config.homeassistant == HomeAssistantConfig(
        discovery="device", prefix="homeassistant", status_topic="homeassistant/status"
    )
    assert config.state_dir == Path(HOME) / ".local/state/wisco2mqtt"
    assert config.lines == (
        LineConfig(
            id="main",
            port="/dev/ttyUSB0",
            baud=9600,
            protocol=LineProtocol.WISCO,
            writes=Writes.AUTO,
            turnaround_s=0.005,
            timeout_s=None,
            silence_s=None,
            late_window_s=0.3,
            output_sweep_s=2.0,
            stations=(
                StationConfig(
                    address=1,
                    model=DIO100,
                    id="main_01",
                    name="main_01",
                    area=None,
                    high_priority=False,
                    rate_limit=20.0,
                    inputs=tuple(InputConfig(channel) for channel in range(1, 17)),
                    outputs=tuple(OutputConfig(channel) for channel in range(1, 9)),
                ),
            ),
        ),
    )


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("./panel", "{folder}/panel"),
        ("../ports/main", "{parent}/ports/main"),
        ("~/panel", "{home}/panel"),
        ("./a/../panel", "{folder}/panel"),
        ("/dev/ttyUSB0", "/dev/ttyUSB0"),
    ],
)
def test_a_relative_port_starts_at_the_folder_of_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: str, meant: str
) -> None:
    """Wherever the command is started; `~` is the home of the user."""
    monkeypatch.chdir("/")
    text = file_with().replace("/dev/ttyUSB0", written)
    [line] = load_text(tmp_path, text).lines
    assert line.port == meant.format(folder=tmp_path, parent=tmp_path.parent, home=HOME)


def test_the_broker_is_on_this_machine_by_default(tmp_path: Path) -> None:
    """Without a section `mqtt` the bridge goes to localhost:1883, without credentials."""
    mqtt = load_text(tmp_path, file_with()).mqtt

    assert mqtt == MqttConfig(
        host="localhost",
        port=1883,
        base_topic="wisco",
        client_id=mqtt.client_id,
        protocol="auto",
        username=None,
        password=None,
        tls=None,
    )


@pytest.mark.parametrize("section", ["mqtt", "homeassistant"])
def test_an_empty_section_is_as_good_as_none(tmp_path: Path, section: str) -> None:
    """A section whose keys are all commented out counts as missing."""
    assert load_text(tmp_path, file_with(top=f"{section}:")) == load_text(tmp_path, file_with())


def test_a_do100_has_sixteen_outputs_and_no_inputs(tmp_path: Path) -> None:
    """The channels follow the model."""
    (line,) = load_text(tmp_path, file_with(model="DO100")).lines

    (config,) = line.stations
    assert config.model == DO100
    assert config.inputs == ()
    assert [output.channel for output in config.outputs] == list(range(1, 17))


@pytest.mark.parametrize(
    ("written", "read"),
    [
        (None, "/var/lib/one"),
        ("/srv/wisco", "/srv/wisco"),
        ("~/wisco", f"{HOME}/wisco"),
        ("state", "{folder}/state"),
    ],
)
def test_a_written_state_dir_wins(tmp_path: Path, written: str | None, read: str) -> None:
    """Over the first that systemd names; it is absolute, below the home, or beside the file."""
    text = file_with(top=f"state_dir: {written}" if written else "")
    config = load_text(tmp_path, text, STATE_DIRECTORY="/var/lib/one:/var/lib/two")

    assert config.state_dir == Path(read.format(folder=tmp_path))


def test_a_machine_without_homes_must_be_told_the_state_dir(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With no home folder at all the default has no place, and the message says what to write."""

    def no_home() -> Path:
        raise RuntimeError

    monkeypatch.setattr(Path, "home", no_home)

    (problem,) = problems_of(tmp_path, file_with(), HOME="")
    assert "state_dir: there is no home folder; write an absolute path" in problem
    assert not problems_of(tmp_path, file_with(top="state_dir: /srv"), HOME="")


def test_without_home_in_the_environment_the_user_database_is_asked(tmp_path: Path) -> None:
    """A service may run without HOME."""
    config = load_text(tmp_path, file_with(), HOME="")

    assert config.state_dir == Path.home() / ".local/state/wisco2mqtt"


# --- finding ----------------------------------------------------------------------------------


def test_a_named_file_is_taken_as_it_is(tmp_path: Path) -> None:
    """`-c FILE` is not searched for; loading it says when it is not there."""
    assert find_config(tmp_path / "other.yaml") == tmp_path / "other.yaml"


def test_the_working_directory_comes_before_etc(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first default file that exists is used; without one, both are named."""
    here, etc = tmp_path / "config.yaml", tmp_path / "etc.yaml"
    monkeypatch.setattr(load, "SEARCHED", (here, etc))

    with pytest.raises(ConfigError) as caught:
        find_config(None)
    assert str(caught.value).startswith(f"{here}:1:1: there is neither this file nor {etc};")
    etc.touch()
    assert find_config(None) == etc
    here.touch()
    assert find_config(None) == here


def test_the_default_files_are_those_of_the_contract() -> None:
    """`config.yaml` in the working directory, then the one below /etc."""
    assert [str(path) for path in load.SEARCHED] == [
        "config.yaml",
        "/etc/wisco2mqtt/config.yaml",
    ]


def test_a_file_that_cannot_be_looked_at_counts_as_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder without permission is named when loading, not passed over in silence."""
    path = tmp_path / ("x" * 300)  # too long a name: an OSError for root, too
    monkeypatch.setattr(load, "SEARCHED", (path, tmp_path))

    assert find_config(None) == path


# --- what cannot be read ----------------------------------------------------------------------


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    """No traceback: one line that says what to do."""
    path = tmp_path / "config.yaml"

    told = f"{path}:1:1: there is no such file; write it, or name another with -c FILE"
    assert _only_problem(path) == told


def test_an_unreadable_file_is_told(tmp_path: Path) -> None:
    """The reason is passed on: here a folder stands in its place."""
    advice = "check what it is and its permissions"
    told = f"{tmp_path}:1:1: cannot be read (it is a directory, not a file); {advice}"
    assert _only_problem(tmp_path) == told


def test_a_file_in_another_encoding_is_told_without_its_content(tmp_path: Path) -> None:
    """Latin-1 is no UTF-8; neither message nor exception chain carries the bytes."""
    path = tmp_path / "config.yaml"
    path.write_bytes(b"mqtt:\n  password: hunter\xe92\n")

    with pytest.raises(ConfigError) as caught:
        load_config(path, {})
    assert str(caught.value) == f"{path}:1:1: line 2 is not UTF-8 text; save the file as UTF-8"
    assert caught.value.__suppress_context__


@pytest.mark.parametrize("text", ["", "\n\n", "# only a comment\n", "---\n", "\ufeff"])
def test_an_empty_file_is_told(tmp_path: Path, text: str) -> None:
    """An empty file is an error that names the example."""
    (problem,) = problems_of(tmp_path, text)
    assert "config.example.yaml" in problem or "lines is missing" in problem


def test_a_byte_order_mark_is_no_problem(tmp_path: Path) -> None:
    """Some editors write one."""
    assert not problems_of(tmp_path, "\ufeff" + file_with())


# --- anything else ----------------------------------------------------------------------------

_WORDS = st.sampled_from(
    [
        *("lines", "mqtt", "homeassistant", "id", "port", "stations", "address", "model", "inputs"),
        *("outputs", "tls", "url", "name", "DIO100", "main", "/dev/ttyUSB0", "9600", "wisco", "1"),
        *("010", "0x1", "on", "off", "true", "false", "null", "~", "50ms", "auto", "<<", "?", "|"),
        *("!env", "!file", "!x", "&a", "*a", ">", "'", '"', "%YAML", "---", "...", "#", "@"),
        *(r"\U0011FFFF", r"\ud800", "-", ":", "\t"),
    ]
)
_GLUE = st.sampled_from(
    [": ", ":\n", "\n", "\n  ", "\n    ", "\n  - ", " ", ", ", "[", "]", "{", "}"]
)
_YAMLISH = st.lists(st.one_of(_WORDS, _GLUE, st.text(max_size=3)), max_size=40).map("".join)


def _encoded(text: str) -> bytes:
    return text.encode("utf-8", "surrogatepass")


def _load_bytes(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "config.yaml"
        path.write_bytes(data)
        problems: tuple[Problem, ...] | None = None
        try:
            load_config(path, {"HOME": HOME})
        except ConfigError as error:
            problems = error.problems
    assert problems is None or len("\n".join(map(str, problems)).splitlines()) == len(problems) > 0


@given(_YAMLISH)
def test_whatever_stands_there_only_a_config_error_comes(text: str) -> None:
    """Pieces of YAML in any order never lead to another exception."""
    _load_bytes(_encoded(text))


@given(st.binary(max_size=60))
def test_any_bytes_lead_to_a_config_error_at_worst(data: bytes) -> None:
    """Nor do bytes that are no text at all."""
    _load_bytes(data)


@given(st.data())
def test_a_valid_file_with_one_piece_replaced_never_breaks_the_loader(data: st.DataObject) -> None:
    """A slip of the hand in a good file: loaded, or refused with its problems."""
    text = file_with(
        top="mqtt: {host: localhost}",
        line="silence: 0",
        station_keys="inputs:\n  1: {name: Door, debounce: 50ms}\n  2: false",
    )
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(start + 12, len(text))))
    piece = data.draw(st.one_of(_WORDS, _GLUE, st.text(max_size=4)))
    _load_bytes(_encoded(text[:start] + piece + text[end:]))
