"""docs/commands/ says what `--help` says."""

import pytest

from bridge.cli.frame.usage import actions_of
from bridge.cli.main import COMMANDS, command_parser, load_command
from reference.__main__ import FOLDER
from reference.page import page, pages


def test_the_pages_are_those_of_the_code() -> None:
    """`make docs` was not forgotten, and no page is left of a command that is gone."""
    there = {path.name: path.read_text() for path in FOLDER.iterdir()}
    assert there == pages(), "make docs writes docs/commands/ anew"


@pytest.mark.parametrize("name", COMMANDS)
def test_a_page_has_every_option_and_an_example(name: str) -> None:
    """Each page has every option of its command, with an explanation and an example."""
    command = load_command(name)
    text = page(command)
    for action in actions_of(command_parser(command)):
        assert action.help, action.dest
        assert all(f"`{option}" in text for option in action.option_strings)
    assert command.EXAMPLES
    assert all(f"\nwisco2mqtt {line}\n" in text for line in command.EXAMPLES)
