"""Local rules: G1 events under every fault, G2 how soon a press is on the wire."""

import sys
from itertools import product
from statistics import quantiles

from proofs.figures import Figure, Run, proof
from proofs.house_fuzz.plan import WAYS
from proofs.rule_houses import answered, troubled

CASES = {"A": (9600, 1), "B": (19200, 8), "C": (57600, 31)}
PROTOCOLS = ("modbus-rtu", "modbus-ascii", "wisco")


@proof("G1")
def an_event_acts_once_or_not_at_all(run: Run) -> Figure:
    """Lost replies, dead modules, lost ports, brokers, reloads, hands, suspends, restarts."""
    each = run.scale.of(10, 2500)
    told = [troubled(way, each) for way in WAYS]
    broken = [text for one in told for text in one.broken]
    for text in broken[:5]:
        print(text, file=sys.stderr)
    orders = sum(one.counts["rule orders on the wire"] for one in told)
    return Figure(
        injected=f"{sum(one.events for one in told)} events of 9 rules under faults, 4 ways",
        seen=f"{len(broken)} broken; {orders} orders on the wire, the last "
        f"{max(one.slowest_s for one in told):.2f} s after its event; "
        f"{sum(one.unseen for one in told)} events unseen: 0 acted",
        promised="at most once each, within 2 s, none by a first read",
        kept=not broken and all(one.events >= each for one in told) and orders > 0,
    )


@proof("G2")
def a_press_is_on_the_wire_in_time(run: Run) -> Figure:
    """The real bus in virtual time; on one line and across lines, with a broker and without."""
    presses, late, figures = run.scale.of(3, 200), 0, []
    cases = list(CASES)[: run.scale.of(1, len(CASES))]
    for letter, across, broker in product(cases, (False, True), (True, False)):
        took_s = list[float]()
        for protocol in PROTOCOLS:
            answers = answered(protocol, *CASES[letter], presses, across=across, broker=broker)
            late += sum(one > answers.bound_s for one in answers.took_s)
            took_s += answers.took_s
        p50, p99 = (1000 * quantiles(took_s, n=100)[n] for n in (49, 98))
        where, with_it = "across" if across else "line", "up" if broker else "down"
        figures.append(f"{letter} {where} {with_it} {p50:.0f}/{p99:.0f}")
    print(f"G2 p50/p99 in ms: {'; '.join(figures)}", file=sys.stderr)
    return Figure(
        injected=f"{presses} presses each: {len(cases)} cases, 3 protocols, 2 ways, broker or not",
        seen=f"{late} late; p50/p99 {figures[0]}, {figures[-1]} ms",
        promised="the bound of the input and 2 exchanges",
        kept=late == 0,
    )
