"""The fuzz of the panel with a key, in short; `python -m panel.fuzz` is the long one."""

from pathlib import Path

import pytest
from panel.fuzz import is_command, run


def test_requests_by_chance_write_nothing_that_is_no_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With a key that switches and one that looks: no error of ours, no secret, it lives on."""
    run(tmp_path, 600, seed=14)
    told = capsys.readouterr().out
    assert "2 wrote" in told
    assert "0 wrote" in told


@pytest.mark.parametrize(
    ("path", "body", "expected"),
    [
        (b"/api/command", b'{"station": "garage", "target": "do/1", "payload": "ON"}', True),
        (b"/api/command?x", b'{"station": "pumps", "target": "do", "payload": {"1": "ON"}}', True),
        (b"/api/command", b'{"station": "garage", "target": "do/9", "payload": "ON"}', False),
        (b"/api/command", b'{"station": "garage", "target": "do/1", "payload": "OM"}', False),
        (b"/api/scan", b'{"station": "garage", "target": "do/1", "payload": "ON"}', False),
        (b"/api/command", b'{"station": "garage", "target": "do/1", "payload": "ON"', False),
    ],
)
def test_a_command_is_told_apart(path: bytes, body: bytes, expected: bool) -> None:
    """By its grammar alone."""
    assert is_command("POST", path, body) is expected
