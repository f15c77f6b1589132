"""`config_version`: files of earlier releases go on working, and are warned of changed keys."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from support.config_file import file_with, load_text, problems_of
from support.house import CELLAR, GARAGE, make_config

from bridge import __version__
from bridge.config.advice import advice_on
from bridge.config.load import load_config
from bridge.config.schema import CURRENT_VERSION, OLDEST_VERSION

RELEASES = Path(__file__).parent / "releases"
CHANGES = Path(__file__).parents[2] / "CHANGELOG.md"


def test_there_is_a_file_of_each_release() -> None:
    """Each release of the changelog, and the one that is next, has a file that is tried here."""
    released = re.findall(r"^## \[([0-9.]+)\]", CHANGES.read_text(), re.MULTILINE)
    assert {*released, __version__} <= {path.stem for path in RELEASES.glob("*.yaml")}


@pytest.mark.parametrize("path", sorted(RELEASES.glob("*.yaml")), ids=lambda path: str(path.stem))
def test_a_file_of_a_release_loads(path: Path) -> None:
    """It is taken as it stands, without `config_version`."""
    assert load_config(path, {}).version == OLDEST_VERSION


def test_the_rate_limit_of_the_first_release_is_carried_over_and_warned_of() -> None:
    """The value stays; one line names the station, what changed, and how to end the warning."""
    config = load_config(RELEASES / "0.1.0.yaml", {})

    assert config.lines[0].stations[0].rate_limit == 5.0
    (told,) = advice_on(config)
    assert told.startswith("station garage: rate_limit limits pulses, TOGGLE and settings")
    assert told.endswith(f"write config_version: {CURRENT_VERSION} at the top of the file")


def test_who_wrote_the_present_version_is_not_warned() -> None:
    """The same file with the present version at its top gets no advice."""
    config = load_config(RELEASES / "0.1.0.yaml", {})

    assert list(advice_on(replace(config, version=CURRENT_VERSION))) == []


@pytest.mark.parametrize(
    "shipped",
    [
        "config.example.yaml",
        "packaging/debian/config.yaml",
        "packaging/home-assistant/wisco2mqtt/start.py",
        "packaging/image/config/config.yaml",
    ],
)
def test_what_a_release_brings_has_its_version(shipped: str) -> None:
    """A new house begins with the present meaning, and is told of the next change alone."""
    text = (CHANGES.parent / shipped).read_text()
    assert re.findall(r"^config_version: (\d+)", text, re.MULTILINE) == [str(CURRENT_VERSION)]


def test_many_stations_make_one_line() -> None:
    """Three of them are named, and the others are counted."""
    limited = tuple(replace(GARAGE, id=f"s{n}", address=n, rate_limit=1.0) for n in range(1, 6))
    config = replace(make_config(stations=(*limited, CELLAR)), version=OLDEST_VERSION)

    (told,) = advice_on(config)
    assert told.startswith("station s1, s2, s3 and 2 more: rate_limit")


def test_a_later_version_is_refused(tmp_path: Path) -> None:
    """A file of a later release is no file of this one: it could be misread."""
    later = CURRENT_VERSION + 1

    (problem,) = problems_of(tmp_path, file_with(top=f"config_version: {later}"))
    assert problem.startswith(f"1:17 config_version: {later} is of a later wisco2mqtt")


@pytest.mark.parametrize("written", ["0", "'2'", "two", "1.5"])
def test_a_version_is_a_whole_number_from_one(tmp_path: Path, written: str) -> None:
    """All else is one problem at its place."""
    (problem,) = problems_of(tmp_path, file_with(top=f"config_version: {written}"))
    assert problem.startswith("1:17 config_version: ")


def test_the_version_of_the_file_is_kept(tmp_path: Path) -> None:
    """What the file names is what it has."""
    assert load_text(tmp_path, file_with(top="config_version: 1")).version == 1
