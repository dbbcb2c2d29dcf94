"""Certificates against true errors: effectivity, alarms, corrections, times.

The samples are those of a run's test split. An alarm tells loads unlike those of the training from
the test split, or wrong predictions from others, by a measure of the certificate; it is rated by
the area under its receiver operating characteristic (AUROC). All times are CPU times of one thread.

    python -m experiments benchmark certificates RUN DATASET

writes its record and its page, and with `--figure FILE` a figure:
prediction, true error and estimated error side by side.
"""

from __future__ import annotations

import argparse
import math
import time
import warnings
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import surrogate
from experiments.benchmarks.benchmark import Results, case_of
from experiments.framework.report import markdown_table
from experiments.framework.timing import timed
from experiments.measures.alarms import alarms, alarms_of_errors, judge, judge_unusual
from experiments.measures.certificates import SETTLED, Certified, certified, fast_measures
from experiments.measures.corrections import Work, efforts
from shared_schema.common import Parser
from shared_schema.common.drawing import save
from surrogate import Dataset, read_dataset
from surrogate.figures import error_beside_certificate
from surrogate.learning.inference import drawn_loads, fit_fast_certificate

Array = NDArray[np.float64]
LOADS = 300  # of every kind
NEW_LOADS = 1000
PASSES = 20


def measure(options: argparse.Namespace) -> Results:
    """Measure everything on one run and its dataset."""
    warnings.simplefilter("ignore", surrogate.OutsideTrainingWarning)
    model, dataset = surrogate.load(options.run), read_dataset(options.dataset)
    force = dataset.nodal_test.force[: options.samples]
    reference = dataset.nodal_test.displacement[: options.samples]
    predicted = model.predict(force)
    model.certify(force[:1], predicted[:1])  # sets the body up
    _, seconds = timed(lambda: model.certify(force, predicted), time.process_time)
    found = certified(model, force, reference, predicted)
    few = force[: options.unusual or len(force)]
    inside, unusual = judge(model, few, PASSES), judge_unusual(model, few, PASSES)
    if options.figure is not None:
        draw(options.figure, found, reference)
    return {
        "case": dataset.manifest.name,
        "degrees_of_freedom": int(model.body.equilibrium.free.sum()),
        "samples": len(force),
        "milliseconds": 1e3 * seconds / len(force),
        "estimate": found.measures(),
        "correction": correction_measures(model, force, predicted, reference),
        "fast": fast(dataset, found, reference),
        "auroc": alarms(inside, unusual),
        "auroc_of_errors": {k: asdict(w) for k, w in alarms_of_errors(inside, unusual).items()},
    }


def correction_measures(
    model: surrogate.Surrogate, force: Array, predicted: Array, truth: Array
) -> Results:
    """Correct predictions, and the worst possible ones; compare with the dataset."""
    nothing = np.full_like(predicted[0], np.nan)
    count = min(len(force), 200 if predicted.shape[2] == 2 else 25)

    def ways(k: int) -> dict[str, Work]:
        return {
            "prediction": lambda: model.correct(force[k], predicted[k]),
            "nothing": lambda: model.correct(force[k], nothing),
        }

    results: Results = {"samples": count}
    for name, effort in efforts(ways, count).items():
        differences = [np.abs(c.displacement - truth[k]).max() for k, c in effort.found.items()]
        results[name] = {
            "milliseconds": 1e3 * float(effort.seconds.mean()),
            "mean_iterations": float(effort.iterations.mean()),
            "most_iterations": int(effort.iterations.max()),
            "largest_difference": float(max(differences)),
        }
    return results


def fast(dataset: Dataset, found: Certified, reference: Array) -> Results:
    """Coverage, width and time of the fast certificate; on new loads, against the full estimate.

    The certificate is that of the run's folder, or fitted where there is none.
    """
    model = found.surrogate
    if model.run.fast_certificate.is_file():
        certificate = model.fast_certificate
    else:
        certificate = fit_fast_certificate(model, dataset, 1, 0)
    results = fast_measures(certificate, found, reference)
    if found.dimension == 2:
        new = drawn_loads(model, NEW_LOADS, np.random.default_rng(0))
        u = model.predict(new)
        results["new_loads"] = certificate.measures(new, u, u - model.certify(new, u).error)
        results["new_loads"]["loads"] = NEW_LOADS
    return results


def draw(path: Path, found: Certified, truth: Array) -> None:
    """Draw the test load with the third largest displacement of a component."""
    shown = int(np.argsort(np.abs(truth).max(axis=(1, 2)))[-3])
    of_load = found.predicted[shown], truth[shown], found.certificate.error[shown]
    save(error_beside_certificate(found.surrogate.geometry, *of_load), path)


def alarm_names(results: Results) -> list[str]:
    """Names of all alarms."""
    return list(dict.fromkeys(name for of_kind in results["auroc"].values() for name in of_kind))


def alarm_rows(results: Results) -> list[list[str]]:
    """Lines of the table of alarms, one for each kind of loads."""
    rows = []
    for kind, areas in results["auroc"].items():
        errors = results["auroc_of_errors"][kind]
        cells = [
            f"{errors['auroc'].get(name, math.nan):.3f} ({areas[name]:.3f})".replace("nan", "–")
            if name in areas
            else "–"
            for name in alarm_names(results)
        ]
        rows.append([kind, f"{errors['wrong']} of {errors['loads']}", *cells])
    return rows


ABOUT = f"""\
Loads of the test split. Estimates are compared with true errors, to solutions with a residual of
{SETTLED:g} N; fast bounds with errors to those of the dataset, 1e-08 N. Times are of one thread.
In the second table, loads are outside the training. A prediction is *wrong* if its error is larger
than any of the test split. The numbers are the probability (AUROC) that the score of a wrong
prediction is above that of another one, of this kind or of the test split; in parentheses, that the
score of a load of this kind is above that of one of the test split, though the network may be
right.
"""


def page(results: Results) -> str:
    """Make the page."""
    estimate, correction = results["estimate"], results["correction"]
    percentiles, fast = estimate["effectivity_percentiles"], results["fast"]
    rows: list[list[str]] = [
        ["loads, degrees of freedom", f"{results['samples']}, {results['degrees_of_freedom']}"],
        [
            "estimated over true error: 5 %, median, 95 %",
            f"{percentiles['5']:.3f}, {percentiles['50']:.4f}, {percentiles['95']:.3f}",
        ],
        ["rank correlation (Spearman)", f"{estimate['spearman']:.4f}"],
        ["estimates that settle", f"{estimate['settled']:.1%}"],
        [
            "median error, and less its estimate, 10⁻³ m",
            f"{1e3 * estimate['median_error_before']:.3g}, "
            f"{1e3 * estimate['median_error_without_estimate']:.3g}",
        ],
        [
            "full and fast certificate, ms",
            f"{results['milliseconds']:.3g}, {fast['median_milliseconds']:.3g}",
        ],
    ]
    for name in ("prediction", "nothing"):
        one = correction[name]
        rows.append(
            [
                f"correction from {name}: Newton iterations, ms",
                f"{one['mean_iterations']:.2f}, {one['milliseconds']:.3g}",
            ]
        )
    for where in ("test_split", "new_loads"):
        for bound in fast.get(where, {}).get("mean", [])[-1:]:
            rows.append(
                [
                    f"fast bound of {bound['level']:.0%}, {where.replace('_', ' ')}: coverage, "
                    "median ratio to the error",
                    f"{bound['coverage']:.1%}, {bound['median_width']:.3g}",
                ]
            )
    table = markdown_table(["quantity", "value"], rows)
    alarms = markdown_table(["loads", "wrong", *alarm_names(results)], alarm_rows(results))
    return f"{table}\n{alarms}"


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("run", help="run folder, or a network of the package")
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--samples", type=int, default=LOADS, help="of every kind")
    parser.add_argument("--unusual", type=int, help="of every kind of unusual load, if fewer")
    parser.add_argument("--figure", type=Path)


def variant(options: argparse.Namespace) -> str:
    """End of the name of the record."""
    return case_of(options.dataset)


TITLE = "Certificates"
PART = "`{case}`"
