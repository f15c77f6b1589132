"""`scan --write` at a terminal, interrupted: what was found so far is shown, and offered."""

import signal
import sys
from pathlib import Path

import pytest
from support.laptop import Laptop, panel_of
from support.mosquitto import free_port
from support.person_screen import PersonScreen


@pytest.mark.parametrize("answer", ["y", "n"])
def test_what_was_found_so_far_is_offered(answer: str, tmp_path: Path) -> None:
    """Yes writes it, no leaves it; the status is 130 either way, and a line says which."""
    laptop = Laptop(tmp_path, free_port())
    # A busy machine answers late: a thorough scan asks again.
    words = ("scan", "--thorough", str(laptop.port), "--write", "found.yaml")
    command = (sys.executable, "-m", "bridge", *words)
    with panel_of(laptop), PersonScreen(command, cwd=tmp_path) as screen:
        screen.wait_for("2 found")
        screen.process.send_signal(signal.SIGINT)
        screen.wait_for("write what was found so far (2 of them) to found.yaml?")
        screen.type(f"{answer}\n")
        told = "has what was found so far" if answer == "y" else "is not written"
        screen.wait_for(f"interrupted: the scan is not at its end; found.yaml {told}")
        assert screen.wait_for_end() == 130
    assert (tmp_path / "found.yaml").exists() == (answer == "y")
