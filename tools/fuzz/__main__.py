"""A seeded fuzz of all commands of both programs: ``python -m tools.fuzz SECONDS``.

Attack number N with seed S is always the same attack: ``--only N`` repeats it. The counts are
printed as JSON; the exit code is 1 if there is a finding.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import time
from collections import Counter, defaultdict
from dataclasses import asdict
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

from tools.fuzz.attacks import FILES
from tools.fuzz.instability import soft, unstable
from tools.fuzz.material import make_material
from tools.fuzz.meshes import broken_mesh
from tools.fuzz.worker import Worker

ATTACKS = FILES | {
    "unstable loads": unstable,
    "meshes that are none": broken_mesh,
    "tolerances": soft,
}


def main() -> int:
    """Attack for a given time; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    parser.add_argument("seconds", type=float, metavar="SECONDS")
    parser.add_argument("--seed", type=int, default=0, metavar="S")
    parser.add_argument("--only", type=int, metavar="N", help="this attack alone")
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="write the counts there")
    options = parser.parse_args()
    workers = {program: Worker(program) for program in ("datagen", "surrogate")}
    try:
        with TemporaryDirectory() as scratch:
            report = attack(Path(scratch), workers, options.seconds, options.seed, options.only)
    finally:
        for worker in workers.values():
            worker.close()
    text = json.dumps(report, indent=1, ensure_ascii=True) + "\n"
    if options.out is not None:
        options.out.write_text(text)
    print(text, end="")
    return 1 if report["findings"] else 0


def attack(
    scratch: Path, workers: dict[str, Worker], seconds: float, seed: int, only: int | None
) -> dict[str, Any]:
    """Make the material and attack it, with one attack after another of each kind."""
    material = make_material(scratch / "material", workers)
    material.learn(scratch)
    endings: dict[str, Counter[str]] = defaultdict(Counter)
    commands: Counter[str] = Counter()
    findings: list[dict[str, Any]] = []
    number, began = only or 0, time.monotonic()
    while time.monotonic() - began < seconds:
        kind = list(ATTACKS)[number % len(ATTACKS)]
        folder = scratch / "attacked"
        outcome = ATTACKS[kind](Random(f"{seed} {number}"), material, folder)
        shutil.rmtree(folder)
        endings[kind][outcome.ending] += 1
        commands[outcome.command] += 1
        if outcome.finding:
            findings.append({"number": number, "attack": kind, **asdict(outcome)})
            print(f"{number}: {kind}: {outcome.command}: {outcome.finding}", file=sys.stderr)
        if only is not None:
            break
        number += 1
    return {
        "seed": seed,
        "seconds": round(time.monotonic() - began),
        "attacks": sum(commands.values()),
        "endings": {kind: dict(sorted(counts.items())) for kind, counts in endings.items()},
        "commands": dict(sorted(commands.items())),
        "findings": findings,
    }


if __name__ == "__main__":
    sys.exit(main())
