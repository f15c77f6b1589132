"""All proofs: importing the groups enters them."""

import importlib
import pkgutil

import proofs
from proofs.figures import PROOFS

for _group in pkgutil.iter_modules(proofs.__path__):
    if _group.name.startswith("group_"):
        importlib.import_module(f"proofs.{_group.name}")

__all__ = ["PROOFS"]
