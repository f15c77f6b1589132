"""What is installed is what was locked, and nothing names a machine that we fetched it from."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parent.parent
SETS = ("run", "debian", "demo", "dev", "home-assistant", "release")
_PEOPLE = ("debian", "demo", "dev")
IN_SETS = {"demo": ("demo", "dev"), "cli": _PEOPLE, "web": _PEOPLE}
OF_A_GROUP = ("dev", "home-assistant", "release")


def project() -> dict[str, Any]:
    """Reads pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def locked(name: str) -> dict[str, str]:
    """Gives the names and versions of one set of locked requirements."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text()
    return dict(re.findall(r"(?m)^([a-z0-9-]+)==([^\s;]+)", text))


def normal(name: str) -> str:
    """Gives a distribution's name as a lock file spells it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def wanted(name: str) -> list[Requirement]:
    """Gives what pyproject.toml asks for in one set."""
    texts = list(project()["project"]["dependencies"])
    if name in OF_A_GROUP:
        texts += project()["dependency-groups"][name]
    extras = project()["project"]["optional-dependencies"]
    for extra, sets in IN_SETS.items():
        texts += extras[extra] if name in sets else []
    return [Requirement(text) for text in texts]


@pytest.mark.parametrize("name", SETS)
def test_locks_hold_names_versions_and_hashes_alone(name: str) -> None:
    """No index, no host and no path: the lock works wherever packages come from."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text()
    marker = r"[a-zA-Z_]+ [=!<>]=? '[\w.]+'"
    package = rf"[a-z0-9-]+==[^\s;]+(?: ; {marker}(?: and {marker})*)?"
    pins = re.fullmatch(rf"(?:{package}(?: \\\n    --hash=sha256:[0-9a-f]{{64}})+\n)+", text)
    assert pins


@pytest.mark.parametrize("name", SETS)
def test_locks_hold_what_the_project_asks_for(name: str) -> None:
    """A dependency that was added or raised has gone through `make lock`."""
    versions = locked(name)
    for requirement in wanted(name):
        assert versions[normal(requirement.name)] in requirement.specifier


def test_the_sets_agree() -> None:
    """Demo and tests lock the same versions as the daemon."""
    run, debian, demo, dev, home_assistant, release = (locked(name) for name in SETS)
    assert run.items() <= debian.items() <= demo.items() <= dev.items()
    assert run.items() <= home_assistant.items()
    assert run.items() <= release.items()
