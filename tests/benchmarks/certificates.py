"""Certificates against true errors: effectivity, alarms, corrections, times.

The samples are those of a run's test split. An alarm tells loads unlike those of the training from
the test split by a measure of the certificate; it is rated by the area under its receiver operating
characteristic (AUROC). No solutions are needed for it. All times are CPU times of one
thread.

    OMP_NUM_THREADS=1 .venv-surrogate/bin/python -m tests.benchmarks.certificates RUN DATASET

writes `docs/results/benchmark-certificates-CASE.json`, its page, and with `--figure FILE` a figure:
prediction, true error and estimated error side by side.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr
from sklearn.metrics import roc_auc_score

import surrogate
from shared_schema.drawing.figure_style import make_figure, save, styled
from shared_schema.drawing.mesh_drawing import make_drawing
from shared_schema.material import NeoHookean
from surrogate.data.dataset import Dataset, read_dataset
from surrogate.evaluation.error_metrics import node_errors, sample_errors
from surrogate.mechanics.certificate import Certificate, certify
from surrogate.mechanics.equilibrium import Equilibrium
from surrogate.presentation.field_figures import add_field
from tests.benchmarks.publication import (
    Results,
    argument_parser,
    footer,
    markdown_table,
    run_benchmark,
)

Array = NDArray[np.float64]
LOADS = 300  # of every kind


def main() -> None:
    """Measure, and write the results."""
    parser = argument_parser(__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--samples", type=int, default=LOADS, help="of every kind")
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args()
    case = surrogate.load(options.run).description.data.case["name"]
    run_benchmark(
        f"certificates-{case}", "certificates", parser, measure, table, program="surrogate"
    )


def measure(options: argparse.Namespace) -> Results:
    """Measure everything on one run and its dataset."""
    warnings.simplefilter("ignore", surrogate.OutsideTrainingWarning)
    model, dataset = surrogate.load(options.run), read_dataset(options.dataset)
    force = dataset.nodal_test.force[: options.samples]
    truth = dataset.nodal_test.displacement[: options.samples]
    predicted = model.predict(force)
    model.certify(force[:1], predicted[:1])  # sets the body up
    seconds, found = timed(lambda: model.certify(force, predicted))
    if options.figure is not None:
        draw(options.figure, model, force, truth, predicted, found)
    return {
        "case": model.description.data.case["name"],
        "degrees_of_freedom": int(model.equilibrium.free.sum()),
        "samples": len(force),
        "milliseconds": 1e3 * seconds / len(force),
        "estimate": compared(found, predicted, truth),
        "correction": corrected(model, force, predicted, truth),
        "auroc": alarms(model, dataset, found, options.samples),
    }


def timed(work: Callable[[], Certificate]) -> tuple[float, Certificate]:
    """CPU time of some work, and its result."""
    began = time.process_time()
    result = work()
    return time.process_time() - began, result


def compared(found: Certificate, predicted: Array, truth: Array) -> Results:
    """Compare estimated and true errors."""
    true = sample_errors(predicted, truth)
    effectivity = found.mean_error / true
    left = sample_errors(predicted - found.error, truth)
    return {
        "mean_error": float(true.mean()),
        "settled": float(found.settled.mean()),
        "effectivity_percentiles": {
            str(level): float(np.percentile(effectivity, level)) for level in (0, 5, 50, 95, 100)
        },
        "within_0.8_and_1.5": float(((effectivity > 0.8) & (effectivity < 1.5)).mean()),
        "spearman": float(spearmanr(true, found.mean_error)[0]),
        "median_error_before": float(np.median(true)),
        "median_error_without_estimate": float(np.median(left)),
        "raised": int((left > true).sum()),
    }


def corrected(model: surrogate.Surrogate, force: Array, predicted: Array, truth: Array) -> Results:
    """Correct predictions, and the worst possible ones; compare with the dataset."""
    wrong: dict[str, Callable[[int], Array]] = {
        "prediction": lambda k: predicted[k],
        "nothing": lambda k: np.full_like(predicted[k], np.nan),
    }
    count = min(len(force), 200 if predicted.shape[2] == 2 else 25)
    results: Results = {"samples": count}
    for name, start in wrong.items():
        began = time.process_time()
        found = [model.correct(force[k], start(k)) for k in range(count)]
        results[name] = {
            "milliseconds": 1e3 * (time.process_time() - began) / count,
            "mean_iterations": float(np.mean([one.iterations for one in found])),
            "most_iterations": max(one.iterations for one in found),
            "largest_difference": float(
                max(np.abs(one.displacement - truth[k]).max() for k, one in enumerate(found))
            ),
        }
    return results


def alarms(
    model: surrogate.Surrogate, dataset: Dataset, inside: Certificate, samples: int
) -> Results:
    """AUROC of the certificate for every kind of load unlike those of the training."""
    force = dataset.nodal_test.force[:samples]
    limit = np.array(dataset.info.force.max_abs)
    rng = np.random.default_rng(0)
    free = np.flatnonzero(~dataset.geometry.clamped)
    never = np.setdiff1d(free, np.flatnonzero(dataset.geometry.loadable))
    most = model.description.data.loads
    several = 3 * (1 if most is None else most.most)
    at_limit = force / (np.abs(force) / limit).max(axis=(1, 2), keepdims=True)
    kinds = {
        "twice the range": 2 * at_limit,  # by the largest component
        "four times the range": 4 * at_limit,
        "three times as many loads": random_loads(rng, free, several, limit, force.shape),
    }
    if len(never):
        kinds["untrained places"] = random_loads(rng, never, 1, limit, force.shape)
    found = {name: model.certify(loads) for name, loads in kinds.items()}
    material = model.description.data.material
    assert isinstance(material, NeoHookean)
    softer = material.model_copy(update={"young_modulus": 400.0})
    other = Equilibrium(dataset.geometry, softer)
    found["another material"] = certify(other, force, model.predict(force))
    measures: dict[str, Callable[[Certificate], Array]] = {
        "mean_error": lambda one: one.mean_error,
        "relative_error": lambda one: one.relative_error,
        "out_of_balance": lambda one: one.out_of_balance,
    }
    return {
        kind: {name: auroc(of(inside), of(one)) for name, of in measures.items()}
        for kind, one in found.items()
    }


def auroc(inside: Array, outside: Array) -> float:
    """Probability that a score outside is above one inside; infinite ones are the highest."""
    scores = np.minimum(np.concatenate([inside, outside]), 1e9)
    return float(roc_auc_score(np.repeat([0, 1], [len(inside), len(outside)]), scores))


def random_loads(
    rng: np.random.Generator,
    nodes: NDArray[np.int64],
    count: int,
    limit: Array,
    shape: tuple[int, ...],
) -> Array:
    """Load cases with `count` random forces within the range, at some of the nodes."""
    force = np.zeros(shape)
    for one in force:
        chosen = rng.choice(nodes, min(count, len(nodes)), replace=False)
        one[chosen] = rng.uniform(-limit, limit, (len(chosen), shape[2]))
    return force


@styled
def draw(
    path: Path,
    model: surrogate.Surrogate,
    force: Array,
    truth: Array,
    predicted: Array,
    found: Certificate,
) -> None:
    """Draw prediction, true error and estimated error of the test load with the largest tip."""
    shown = int(np.argsort(np.abs(truth).max(axis=(1, 2)))[-3])
    figure = make_figure(12.0, 2.9)
    x = model.geometry.coordinates
    fields = {
        "displacement in m": np.linalg.norm(predicted[shown], axis=1),
        "true error in mm": 1e3 * node_errors(predicted[shown], truth[shown]),
        "estimated error in mm": 1e3 * np.linalg.norm(found.error[shown], axis=1),
    }
    for position, (label, values) in zip((131, 132, 133), fields.items(), strict=True):
        drawing = make_drawing(figure, model.geometry, position)
        add_field(drawing, x + predicted[shown], values, label)
        drawing.finish()
    save(figure, path)


def table(results: Results) -> str:
    """Make the page."""
    estimate, correction = results["estimate"], results["correction"]
    percentiles = estimate["effectivity_percentiles"]
    rows: list[list[str]] = [
        ["mean error of the predictions, 10⁻³ m", f"{1e3 * estimate['mean_error']:.3g}"],
        ["median of estimated over true error", f"{percentiles['50']:.4f}"],
        ["5 and 95 % percentiles", f"{percentiles['5']:.3f}, {percentiles['95']:.3f}"],
        ["rank correlation (Spearman)", f"{estimate['spearman']:.4f}"],
        ["estimates that settle", f"{estimate['settled']:.1%}"],
        ["median error before, 10⁻³ m", f"{1e3 * estimate['median_error_before']:.3g}"],
        [
            "median error less its estimate, 10⁻³ m",
            f"{1e3 * estimate['median_error_without_estimate']:.3g}",
        ],
        ["samples whose error that raises", str(estimate["raised"])],
        ["certificate, ms of CPU time", f"{results['milliseconds']:.3g}"],
    ]
    for name in ("prediction", "nothing"):
        one = correction[name]
        rows += [
            [f"correction from {name}: Newton iterations", f"{one['mean_iterations']:.2f}"],
            [f"correction from {name}: ms of CPU time", f"{one['milliseconds']:.3g}"],
        ]
    for kind, values in results["auroc"].items():
        rows += [[f"AUROC of {name}, {kind}", f"{value:.4f}"] for name, value in values.items()]
    return "\n".join(
        [
            f"# Certificates of `{results['case']}`",
            "",
            f"{results['samples']} loads of the test split, "
            f"{results['degrees_of_freedom']} degrees of freedom.",
            "",
            markdown_table(["quantity", "value"], rows),
            footer(results),
        ]
    )


if __name__ == "__main__":
    main()
