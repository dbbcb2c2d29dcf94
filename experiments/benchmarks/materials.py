"""Load series and directions for rubbers, fibres and pressure: how many loads are within 0.5 %.

    python -m experiments benchmark materials

writes its record and its page. Bodies and the errors of their loads stay in the folder `--work`, so
that a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.benchmarks.benchmark import Results
from experiments.framework.factory import factory
from experiments.framework.report import markdown_table
from shared_schema.common import InputError, Parser, WorkError, write_text
from shared_schema.common.progress import Progress
from surrogate.mechanics.descent import Aim
from surrogate.mechanics.sampling.sampled_body import SampledBody
from surrogate.mechanics.statics.prediction import Series

TITLE = "Other materials, and pressure"
ABOUT = (
    "Fresh loads of shipped cases, also with other materials in place of the Neo-Hookean one, "
    "whose moduli at rest are those of the case (nearly, with fibres). The error of a load is that "
    "of its worst node, relative to the largest displacement, against the equilibrium that the "
    "correction reaches. *Within* are loads with an error of at most 0.5 %: by the load series of "
    "order 5 alone, and with `--tolerance 5e-3`. *Claimed wrongly* are loads of which the "
    "directions say that they are within 0.5 %, and are not. *No equilibrium* are loads that "
    "neither directions nor correction solve; they count in no other column."
)
TOLERANCE, ORDER, AT_ONCE = 5e-3, 5, 20
FIBRES = {"model": "holzapfel_gasser_ogden", "c10": 90, "k1": 100, "k2": 2, "bulk_modulus": 833}
ALONG = [[1, 0.5, 0], [1, -0.5, 0]]
MATERIALS: dict[str, dict[str, Any]] = {  # shear modulus 178.6 Pa, as E = 500 Pa and ν = 0.4
    "yeoh": {"model": "yeoh", "c10": 89.3, "c20": 5, "c30": 0.5, "bulk_modulus": 833},
    "gent": {"model": "gent", "shear_modulus": 178.6, "limit": 20, "bulk_modulus": 833},
    "mooney_rivlin": {"model": "mooney_rivlin", "c10": 62.5, "c01": 26.8, "bulk_modulus": 833},
    "ogden": {"model": "ogden", "mu": [60, -58.6], "alpha": [4, -2], "bulk_modulus": 833},
    "fibres": {**FIBRES, "compression": True, "fibres": ALONG},
    "fibres in tension": {**FIBRES, "fibres": ALONG},
}
STIFFER = {"breast3d": 1.6}  # Young's modulus over 500 Pa
IN_PA = ("c10", "c20", "c30", "c01", "mu", "k1", "shear_modulus", "bulk_modulus")
BODIES = ["finger3d", "beam3d_any", "breast3d"]
BODIES += [f"{case}: {name}" for case in ("beam3d_any", "breast3d") for name in MATERIALS]


def body_of(name: str, work: Path) -> Path:
    """Make the body of a case, with another material if the name has one."""
    case, _, material = name.partition(": ")
    folder = work / name.replace(": ", "-").replace(" ", "_")
    if material not in ("", *MATERIALS) or not case:
        raise InputError(f"--bodies '{name}': expected CASE or CASE: {', '.join(MATERIALS)}")
    change: list[str] = []
    if material:
        factor = STIFFER.get(case, 1.0)
        scaled = {
            key: (factor * np.array(value)).round(6).tolist() if key in IN_PA else value
            for key, value in MATERIALS[material].items()
        }
        change = ["--set", f"material={json.dumps(scaled)}"]
    if not folder.is_dir():
        factory("body", case, *change, "--out", folder)
    return folder


def errors(name: str, count: int, seed: int, work: Path) -> list[dict[str, Any]]:
    """Errors of the loads of a body, some at a time, which the folder keeps."""
    folder = body_of(name, work)
    kept = folder.with_name(f"{folder.name}-{count}-{seed}.json")
    rows: list[dict[str, Any]] = json.loads(kept.read_text()) if kept.is_file() else []
    if len(rows) < count:
        sampled = SampledBody.read(folder, count, seed)
        series, progress = Series(sampled.body, ORDER), Progress(count, len(rows), "loads", name)
        while len(rows) < count:
            rows += compared(sampled, series, range(len(rows), min(count, len(rows) + AT_ONCE)))
            write_text(kept, json.dumps(rows) + "\n")
            progress.update(len(rows))
        progress.close("done")
    return rows


def compared(
    sampled: SampledBody, series: Series, numbers: Sequence[int]
) -> Iterator[dict[str, Any]]:
    """Errors of the series, and of the directions, and what these say; None without a truth."""
    body, loads = sampled.body, sampled.load([sampled.loads[number] for number in numbers])
    predicted, last = series.respond(loads)
    for row, (alone, remainder) in enumerate(zip(predicted, last, strict=True)):
        load = loads.cases[row]
        driven, descent = body.descend(load, alone, Aim(TOLERANCE), float(remainder))
        try:
            true = body.correct(load, driven).displacement
        except WorkError:
            yield {"series": None, "driven": None, "claimed": bool(descent.reached)}
            continue
        size = np.linalg.norm(true, axis=1).max()
        of_series, of_driven = (
            float(np.linalg.norm(each - true, axis=1).max() / size) for each in (alone, driven)
        )
        yield {"series": of_series, "driven": of_driven, "claimed": bool(descent.reached)}


def measure(options: argparse.Namespace) -> Results:
    """Compare the loads of all bodies."""
    found = []
    for name in options.bodies.split(","):
        rows = errors(name, options.loads, options.seed, options.work)
        solved = [row for row in rows if row["driven"] is not None]
        series, driven = (np.array([row[key] for row in solved]) for key in ("series", "driven"))
        claimed = np.array([row["claimed"] for row in solved])
        found.append(
            {
                "body": name,
                "no_equilibrium": len(rows) - len(solved),
                "series_within": float((series <= TOLERANCE).mean()),
                "series_median": float(np.median(series)),
                "within": float((driven <= TOLERANCE).mean()),
                "largest": float(driven.max()),
                "claimed": float(claimed.mean()),
                "claimed_wrongly": int((claimed & (driven > TOLERANCE)).sum()),
            }
        )
    return {"loads": options.loads, "bodies": found}


def page(results: Results) -> str:
    """Make the page."""
    heads = (
        *("body", "series alone within", "its median error", "`--tolerance` within"),
        *("largest error", "claimed", "claimed wrongly", "no equilibrium"),
    )
    rows = [
        (
            row["body"],
            f"{row['series_within']:.1%}",
            f"{row['series_median']:.1e}",
            f"{row['within']:.1%}",
            f"{row['largest']:.1e}",
            f"{row['claimed']:.1%}",
            str(row["claimed_wrongly"]),
            str(row["no_equilibrium"]),
        )
        for row in results["bodies"]
    ]
    return f"{results['loads']} loads each.\n\n{markdown_table(heads, rows)}"


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--bodies", default=",".join(BODIES), help="names, separated by commas")
    parser.add_argument("--loads", type=int, default=400)
    parser.add_argument("--seed", type=int, default=229)
    parser.add_argument("--work", type=Path, default=Path("build/materials"))
