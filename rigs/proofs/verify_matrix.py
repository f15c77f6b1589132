"""Prints what verify says of modules that follow each assumption, and of modules that do not.

`PYTHONPATH=.:tests:rigs python -m proofs.verify_matrix`. One row for each assumption and dialect,
one column for each protocol and model: what is said of the module that follows it, then of the one
that does not.
"""

from bridge.commission.verify.assumptions import ASSUMPTIONS
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.dialect import READINGS, Dialect
from proofs.verified_line import PULSE_OUTPUT, verified

_SHORT = {"as assumed": "ok", "differs": "differs", "not tried": "-"}
_PLACES = [(protocol, model) for protocol in LineProtocol for model in (DIO100, DO100)]


def main() -> None:
    """Print the table."""
    said = {
        (place, dialect): verified(place[0], (place[1],), dialect, output=PULSE_OUTPUT).words
        for place in _PLACES
        for dialect in (None, *Dialect)
    }
    heads = [f"{protocol} {model.name}" for protocol, model in _PLACES]
    print(f"{'assumption':16} {'dialect':16} " + " ".join(f"{head:20}" for head in heads))
    for name in ASSUMPTIONS:
        turned: list[Dialect | None] = [one for one in Dialect if READINGS[one] == name]
        for dialect in turned or [None]:
            cells = [_cell(said[place, None], said[place, dialect], name) for place in _PLACES]
            print(f"{name:16} {dialect or 'none':16} " + " ".join(f"{cell:20}" for cell in cells))


def _cell(follows: dict[str, str], does_not: dict[str, str], name: str) -> str:
    return f"{_SHORT[follows[name]]} / {_SHORT[does_not[name]]}"


if __name__ == "__main__":
    main()
