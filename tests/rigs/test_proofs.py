"""Each proof in its short form: what `make proofs` shows in full holds for a little at least."""

from pathlib import Path

import pytest
from proofs.everything import PROOFS
from proofs.figures import Run, Scale

# What is injected is logged. Other tests cover the lines, and coverage would double the time.
pytestmark = [pytest.mark.warns, pytest.mark.unmeasured]


@pytest.mark.parametrize("identity", PROOFS)
def test_the_promise_is_kept(identity: str, tmp_path: Path) -> None:
    """A small run of each proof finds the promise kept."""
    figure = PROOFS[identity](Run(Scale.SHORT, tmp_path))
    assert figure.kept, f"{identity}: {figure}"
