"""All proofs: importing the groups enters them."""

from proofs.figures import PROOFS

__all__ = ["PROOFS"]
