"""A release whose version, tag and changelog do not agree is not one."""

import pytest
from release.notes import disagreements, notes

CHANGELOG = """# Changes

## [1.2.0] - 2026-11-27

### Added

- A thing.

## [1.1.0] - 2026-10-01

- An older thing.
"""
UNRELEASED = CHANGELOG.replace("[1.2.0] - 2026-11-27", "[Unreleased]")


@pytest.mark.parametrize(
    ("tags", "changelog"), [(["v1.2.0"], CHANGELOG), ([], CHANGELOG), ([], UNRELEASED)]
)
def test_what_agrees(tags: list[str], changelog: str) -> None:
    """A rehearsal, without a tag, may come before the heading has its number."""
    assert disagreements("1.2.0", tags, changelog) == []


@pytest.mark.parametrize(
    ("version", "tags", "changelog", "told"),
    [
        ("1.2.1", ["v1.2.0"], CHANGELOG, "the tag is v1.2.0, and bridge/__init__.py has 1.2.1"),
        ("1.2.0", ["v1.2.0"], UNRELEASED, "begins with [Unreleased], and not with [1.2.0]"),
        ("1.3.0", [], CHANGELOG, "begins with [1.2.0], and not with [1.3.0]"),
    ],
)
def test_what_does_not(version: str, tags: list[str], changelog: str, told: str) -> None:
    """Each is named."""
    assert told in " ".join(disagreements(version, tags, changelog))


def test_notes_are_the_newest_section() -> None:
    """Without its heading, and without the older ones."""
    assert notes(CHANGELOG) == "### Added\n\n- A thing.\n"
