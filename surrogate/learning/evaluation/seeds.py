"""Runs of one configuration with several seeds, RUN/seed-0, RUN/seed-1 …: how far they spread."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from shared_schema.common.errors import InputError
from surrogate.learning.runs.folder import RunFolder, first_difference


def runs_of_seeds(folder: Path) -> list[Path]:
    """Run folders of the seeds in a folder, in their order; none in a run folder.

    Raises
    ------
    InputError
        If two of them differ in more than the seed.
    """
    if (folder / "config.yaml").is_file():
        return []
    found = {file.parent: RunFolder(file.parent) for file in folder.glob("seed-*/config.yaml")}
    configs = {run: of.description().run.plain() for run, of in found.items()}
    runs = sorted(configs, key=lambda run: configs[run]["seed"])
    for run in runs[1:]:
        first, other = (configs[of] | {"seed": None} for of in (runs[0], run))
        if first != other:
            difference = first_difference(first, other).replace("the folder", runs[0].name)
            raise InputError(f"{run}: another {difference}; expected runs that differ in the seed")
    return runs


def spread(evaluations: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Mean, standard deviation, smallest and largest value of all measures of several seeds.

    The standard deviation s = √(Σ (x − x̄)² / (n − 1)) is that of single runs; None for one.

    Parameters
    ----------
    evaluations : sequence of mapping
        Content of ``evaluation.json`` of every seed.
    """
    measures = [measures_of(evaluation) for evaluation in evaluations]
    found: dict[str, Any] = {"seeds": [evaluation["seed"] for evaluation in evaluations]}
    for name in measures[0]:
        values = [of[name] for of in measures]
        std = float(np.std(values, ddof=1)) if len(values) > 1 else None
        ends = {"min": min(values), "max": max(values)}
        found[name] = {"mean": float(np.mean(values)), "std": std, **ends}
    return found


def lines_of(found: Mapping[str, Any], unit: str) -> Iterator[str]:
    """Yield the spread of the mean error, in a unit, and of the coverage if there is one."""
    for name, what in (("mean_error", f"mean error [{unit}]"), ("coverage_95", "coverage of 95%")):
        if (of := found.get(name)) is not None:
            std = "unknown" if of["std"] is None else f"{of['std']:.2g}"
            yield (
                f"{len(found['seeds'])} seeds, {what}: mean {of['mean']:.3g}, standard deviation "
                f"{std}, from {of['min']:.3g} to {of['max']:.3g}"
            )


def measures_of(evaluation: Mapping[str, Any]) -> dict[str, float]:
    """Errors, coverages of the intervals of a probabilistic network, and time of the training."""
    intervals = evaluation.get("uncertainty", {}).get("intervals", ())
    return {
        **{name: value for name, value in evaluation["test"].items() if name != "samples"},
        **{f"coverage_{100 * of['level']:.0f}": of["coverage"] for of in intervals},
        "training_seconds": evaluation["training_seconds"],
    }
