"""A whole house in which anything happens at any time: H1.

`SEED=17 make proofs ONLY=H1` begins with that house. What broke is told with the command that runs
its house alone, in seconds.
"""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from proofs.figures import Figure, Run, proof
from proofs.house_fuzz.plan import WAYS

AT_A_TIME = 2
MOST_MIB = 120
FIRST_SEED = 1


def _houses(way: str, seed: int, steps: int) -> dict[str, Any]:
    """Live through as many houses as it takes, in a process of its own: one core, hashes fixed."""
    command = [sys.executable, "-m", "proofs.house_fuzz", way, f"--seed={seed}", f"--steps={steps}"]
    environ = {**os.environ, "PYTHONHASHSEED": "0", "PYTHONPATH": ".:tests:rigs"}
    ran = subprocess.run(command, env=environ, capture_output=True, text=True, check=False)
    assert ran.stdout, ran.stderr
    told: dict[str, Any] = json.loads(ran.stdout)
    return told


@proof("H1")
def anything_happens_in_a_house(run: Run) -> Figure:
    """Commands, hands, faults, brokers, reloads, suspends, stops: no promise is broken."""
    steps, seed = run.scale.of(80, 250_000), int(os.environ.get("SEED") or FIRST_SEED)
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        told = list(pool.map(partial(_houses, seed=seed, steps=steps), WAYS))
    broken = [text for each in told for text in each["broken"]]
    for text in broken:
        print(text, file=sys.stderr)
    total = {
        key: sum(each["counts"].get(key, 0) for each in told)
        for key in ("steps", "houses", "frames", "commands", "virtual s")
    }
    mib = max(each["counts"]["rss MiB"] for each in told)
    hours = total["virtual s"] / 3600
    return Figure(
        injected=f"{total['steps']} steps in {total['houses']} houses, seed {seed} on",
        seen=f"{len(broken)} broken; {total['frames']} frames, {total['commands']} commands, "
        f"{hours:.0f} h, {mib} MiB",
        promised="0 promises broken",
        kept=not broken and total["steps"] >= steps * len(WAYS) and mib < MOST_MIB,
    )
