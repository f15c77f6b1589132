"""What the documents show is tried: configurations load, commands parse, topics exist."""

import re
import shlex
from pathlib import Path

import pytest

from bridge.cli.main import COMMANDS, parse_arguments
from bridge.config.load import load_config
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator import SimulatedLine, SimulatedModule
from bridge.simulator.scenario import load_scenario

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def _blocks(path: Path, language: str) -> list[str]:
    text = path.read_text()
    found = re.findall(rf"^( *)```{language}\n(.*?)^ *```", text, flags=re.MULTILINE | re.DOTALL)
    return [
        "\n".join(line.removeprefix(indent) for line in body.splitlines()) + "\n"
        for indent, body in found
    ]


def _all(language: str) -> list[tuple[str, str]]:
    return [(path.name, block) for path in DOCUMENTS for block in _blocks(path, language)]


CONFIGURATIONS = [(name, block) for name, block in _all("yaml") if "lines:" in block]
SCENARIOS = [(name, block) for name, block in _all("yaml") if "steps:" in block]
COMMAND_PAGES = ROOT / "docs" / "commands"  # they have synopses too, and their examples are run
COMMAND_LINES = [
    (path.name, re.split(" [#>]", line)[0].strip())
    for path in DOCUMENTS
    if path.parent != COMMAND_PAGES
    for line in re.findall(
        r"(?:^ *(?:\$ )?|`)((?:/\S+/)?wisco2mqtt [^`\n]+)", path.read_text(), re.MULTILINE
    )
]


def _anchors(path: Path) -> set[str]:
    """The headings of a page, as the web names them."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(), flags=re.MULTILINE)
    return {re.sub(r"[^a-z0-9 _-]", "", text.lower()).replace(" ", "-") for text in headings}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_link_between_the_documents_leads_somewhere(path: Path) -> None:
    """To a file that there is, and to a heading of it."""
    for link in re.findall(r"\]\(([^)\s]+)\)", path.read_text()):
        if "://" in link:
            continue
        name, _, heading = link.partition("#")
        target = path.parent / name if name else path
        assert target.exists(), link
        assert not heading or heading in _anchors(target), link


@pytest.mark.parametrize(("name", "text"), CONFIGURATIONS)
def test_a_configuration_in_the_documents_loads(name: str, text: str, tmp_path: Path) -> None:
    """A reader may copy it as it stands; only the credential is not there on this machine."""
    secret = tmp_path / "mqtt-password"
    secret.write_text("s3cret\n")
    text = re.sub(r"!file /run/credentials/\S+", f"!file {secret}", text)
    path = tmp_path / name
    path.write_text(text)
    assert load_config(path, {}).lines


@pytest.mark.parametrize(("name", "text"), SCENARIOS)
def test_a_scenario_in_the_documents_loads(name: str, text: str, tmp_path: Path) -> None:
    """Each scenario in the documents loads on a line with its modules."""
    path = tmp_path / name
    path.write_text(text)
    modules = [SimulatedModule(DIO100, address=1), SimulatedModule(DO100, address=2)]
    line = SimulatedLine(LineProtocol.WISCO, 9600, modules)
    assert load_scenario(path, {"main": line}).steps


@pytest.mark.parametrize(("name", "line"), COMMAND_LINES)
def test_a_command_line_in_the_documents_parses(name: str, line: str) -> None:
    """Each command line in the documents parses."""
    words = shlex.split(line.removeprefix("$ "))
    assert Path(words[0]).name == "wisco2mqtt", name
    assert parse_arguments(words[1:])


def test_the_readme_lists_every_command() -> None:
    """The README lists every command."""
    text = (ROOT / "README.md").read_text()
    assert not [name for name in COMMANDS if f"`wisco2mqtt {name}" not in text]


def test_the_readmes_smallest_configuration_is_among_those_tried() -> None:
    """The tests above cannot pass by finding nothing."""
    assert any(name == "README.md" for name, _ in CONFIGURATIONS)
    assert any(name == "README.md" for name, _ in COMMAND_LINES)
