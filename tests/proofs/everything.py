"""All proofs: importing the groups enters them."""

from proofs import group_a_wire  # noqa: F401  # enters its proofs
from proofs.figures import PROOFS

__all__ = ["PROOFS"]
