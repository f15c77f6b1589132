"""`make proofs`: runs every proof in full, or those named, and prints the table."""

import logging
import sys
import tempfile
import time
from pathlib import Path

from proofs import everything
from proofs.figures import NOT_HERE, Run, Scale


def main(names: list[str]) -> int:
    """Prints a row a proof as it ends; 1 when a promise was not kept."""
    logging.getLogger().addHandler(logging.NullHandler())  # what is injected is no news here
    order = sorted(names or everything.PROOFS, key=lambda name: (name[0], int(name[1:])))
    chosen = {name: everything.PROOFS[name] for name in order}
    broken = []
    print(f"{'id':<4}{'':<4}{'injected':<58}{'seen':<58}{'promised':<50}s")
    for name, prove in chosen.items():
        began = time.monotonic()
        with tempfile.TemporaryDirectory(prefix=f"proof-{name}-") as directory:
            figure = prove(Run(Scale.FULL, Path(directory)))
        mark = "ok" if figure.kept else "NO"
        took_s = time.monotonic() - began
        print(
            f"{name:<4}{mark:<4}{figure.injected:<58}{figure.seen:<58}{figure.promised:<50}"
            f"{took_s:.0f}",
            flush=True,
        )
        if not figure.kept:
            broken.append(name)
    if not names:
        for name, reason in NOT_HERE.items():
            print(f"{name:<4}{'--':<4}not proved here: {reason}")
    if broken:
        print(f"promises not kept: {', '.join(broken)}", file=sys.stderr)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
