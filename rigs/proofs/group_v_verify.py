"""Sure of the real modules: what verify says, and what the bridge makes of other modules."""

import itertools
from collections import Counter
from collections.abc import Callable

from bridge.commission.verify.assumptions import FindingWord
from bridge.model import DIO100, DO100, LineProtocol
from bridge.simulator.dialect import Dialect
from bridge.simulator.faults import is_write
from proofs.busy_line import beside_polls
from proofs.figures import Figure, Run, Scale, proof
from proofs.other_modules import Told, lived_with
from proofs.tuned_line import Rounds, best_fixed, learned, measured
from proofs.verified_line import BAUD, PULSE_OUTPUT, differing, verified

LOST = 0.01
Read = Callable[[float, tuple[float, float], int], Rounds]


@proof("V1")
def verify_tells_what_each_module_does(run: Run) -> Figure:
    """Modules that follow each assumption, and that do not: no verdict is wrong."""
    runs = run.scale.of(1, 100)
    verdicts, wrong, untried = Counter[str](), [], 0
    kinds = list(itertools.product(LineProtocol, (DIO100, DO100), (None, *Dialect)))
    kinds, some = (kinds, "") if run.scale is Scale.FULL else (kinds[::5], "a fifth of ")
    for protocol, model, dialect in kinds:
        due = differing(dialect, protocol, model)
        for seed in range(runs):
            seen = verified(
                protocol, (model,), dialect, seed=seed, lost=LOST, output=PULSE_OUTPUT
            ).words
            verdicts.update(seen.values())
            untried += sum(seen[name] == FindingWord.NOT_TRIED for name in due)
            wrong += [
                (protocol, model.name, dialect, seed, name)
                for name, word in seen.items()
                if (word == FindingWord.DIFFERS and name not in due)
                or (word == FindingWord.AS_ASSUMED and name in due)
            ]
    return Figure(
        injected=f"{some}3 protocols x 2 models x {1 + len(Dialect)} dialects, {runs} runs, "
        "1 % lost",
        seen=f"{len(wrong)} wrong of {verdicts.total()} verdicts {wrong[:3] or ''}; "
        f"{untried} missed",
        promised="0 wrong verdicts",
        kept=not wrong,
    )


@proof("V2")
def other_modules_are_met_or_named(run: Run) -> Figure:
    """States and commands through the bridge in each dialect: true, or named."""
    commands = run.scale.of(4, 1000)
    told: list[Told] = [
        lived_with(dialect, protocol, commands)
        for dialect, protocol in itertools.product(Dialect, LineProtocol)
        # On a line of the other protocol such a module is as good as absent.
        if (dialect, protocol) != (Dialect.WISCO_ONLY, LineProtocol.MODBUS_ASCII)
    ]
    lost = [f"{one.dialect}/{one.protocol}" for one in told if not (one.works or one.named)]
    false, wrong = sum(one.false_states for one in told), sum(one.wrong_switchings for one in told)
    return Figure(
        injected=f"{len(Dialect)} dialects x 3 protocols, {commands} states and commands each",
        seen=f"{false} false states, {wrong} wrong switchings; "
        f"{sum(one.works for one in told)} work, "
        f"{sum(not one.works and one.named for one in told)} named {lost or ''}",
        promised="0 false states, 0 wrong switchings; works or named",
        kept=not false and not wrong and not lost,
    )


@proof("V3")
def verify_only_reads(run: Run) -> Figure:
    """Twelve modules: how long it takes, and that no frame writes."""
    models = (DIO100, DO100) * run.scale.of(1, 6)
    took, writes = [], 0
    for protocol in LineProtocol:
        seen = verified(protocol, models, samples=run.scale.of(30, 100))
        took.append(f"{protocol} {seen.panel.time.now - 1000.0:.0f} s")
        writes += sum(is_write(frame) for _, frame in seen.panel.sent)
    return Figure(
        injected=f"verify on {len(models)} modules at {BAUD} baud, no --output",
        seen=f"{writes} frames that write; {', '.join(took)}",
        promised="0 frames that write",
        kept=not writes,
    )


@proof("V5")
def verify_beside_the_bridge(run: Run) -> Figure:
    """The errand on a line at work: every command is done meanwhile, and nothing else writes."""
    modules = run.scale.of(2, 12)
    seen = [beside_polls(protocol, modules, run.scale.of(20, 100)) for protocol in LineProtocol]
    done, asked = sum(one.done for one in seen), sum(one.asked for one in seen)
    strange = sum(one.other_writes for one in seen)
    slowest_ms = max(one.slowest_ms for one in seen)
    wrong = [finding for one in seen for finding in one.differs]
    took = ", ".join(f"{one.took_s:.0f} s" for one in seen)
    return Figure(
        injected=f"verify on {modules} modules at {BAUD} baud, a command every 0.5 s, 3 protocols",
        seen=f"{done} of {asked} commands done, slowest {slowest_ms} ms; {strange} other writes; "
        f"{len(wrong)} wrong verdicts {wrong[:3] or ''}; {took}",
        promised="all commands done, no other frame writes",
        kept=done == asked and asked > 0 and not strange and not wrong,
    )


@proof("V4")
def the_proposed_settings_are_good(run: Run) -> Figure:
    """Lines that are slow and late: as fast as the best fixed settings, no reply to another."""
    return _compared(run, measured)


@proof("V6")
def learned_times_are_good(run: Run) -> Figure:
    """The same lines with `auto`: once learned, as fast as the best fixed settings."""
    return _compared(run, learned)


def _compared(run: Run, read: Read) -> Figure:
    turnarounds = (0.001, 0.08, 0.005, 0.02, 0.04)[: run.scale.of(2, 5)]
    lates = ((0.0, 0.0), (0.02, 0.25), (0.02, 0.12))
    worst, wrong, places = 0.0, 0, []
    for turnaround_s, late in itertools.product(turnarounds, lates):
        ours = read(turnaround_s, late, run.scale.of(40, 150))
        best_s = best_fixed(turnaround_s, late, run.scale.of(40, 150))
        wrong += ours.to_another
        slower = ours.cycle_s / best_s - 1
        worst = max(worst, slower)
        places.append(f"{turnaround_s * 1000:.0f}/{late[1] * 1000:.0f} {slower:+.1%}")
    return Figure(
        injected=f"{len(places)} lines: turnaround 1-80 ms, 2 % of replies up to 250 ms late",
        seen=f"{worst:+.1%} at the worst, {wrong} replies to another station ({'; '.join(places)})",
        promised="within 5 % of the best fixed settings, 0 to another station",
        kept=worst <= 0.05 and not wrong,
    )
