"""Alarms of several networks for loads outside their training: AUROC of certificates and σ.

    python -m experiments benchmark alarms DATASET RUN …

writes its record and its page. The loads are those of
`experiments.measures.alarms`, as many of each kind as test loads. What is measured of a run is
kept in the folder `--work`, from which a later start resumes.
"""

from __future__ import annotations

import argparse
import json
import warnings
from pathlib import Path

import surrogate
from experiments.benchmarks.benchmark import Benchmark, Results, case_of
from experiments.framework.report import markdown_table
from experiments.measures.alarms import alarms, judge, judge_unusual
from experiments.measures.certificates import certified
from shared_schema.common import Parser, write_text
from surrogate import Dataset, read_dataset


def measure(options: argparse.Namespace) -> Results:
    """Measure every run that has not been measured yet."""
    warnings.simplefilter("ignore", surrogate.OutsideTrainingWarning)
    dataset = read_dataset(options.dataset, on_disk=True)
    found = {}
    for run in options.runs:
        kept = options.work / f"{Path(run).name}.json"
        if not kept.is_file():
            kept.parent.mkdir(parents=True, exist_ok=True)
            result = measured(run, dataset, options.samples, options.passes)
            write_text(kept, json.dumps(result))
        found[Path(run).name] = json.loads(kept.read_text())
    return {"case": dataset.manifest.name, "samples": options.samples, "runs": found}


def measured(run: str, dataset: Dataset, samples: int, passes: int) -> Results:
    """Estimates against errors on the test split, and AUROC of every kind of load."""
    model = surrogate.load(run)
    force = dataset.nodal_test.force[:samples]
    reference = dataset.nodal_test.displacement[:samples]
    judged = judge(model, force, passes)
    measures = certified(model, force, reference, judged.predicted).measures()
    before, once = measures["median_error_before"], measures["median_error_without_estimate"]
    return {
        "network": model.description.run.name,
        "likelihood": model.description.run.likelihood,
        "mean_error": measures["mean_error"],
        "effectivity": list(measures["effectivity_percentiles"].values()),
        "spearman": measures["spearman"],
        "ratio_of_median_errors": before / once,
        "raised": measures["raised"],
        "auroc": alarms(judged, judge_unusual(model, force, passes)),
    }


def page(results: Results) -> str:
    """Make the page."""
    kinds = list(dict.fromkeys(k for one in results["runs"].values() for k in one["auroc"]))
    rows = []
    for name, one in results["runs"].items():
        scores = dict.fromkeys(score for of_kind in one["auroc"].values() for score in of_kind)
        for score in (score for score in scores if score.endswith("over displacement")):
            values = [one["auroc"].get(kind, {}).get(score) for kind in kinds]
            rows.append([f"`{name}`", score, *("–" if v is None else f"{v:.3f}" for v in values)])
    ratios = [one["ratio_of_median_errors"] for one in results["runs"].values()]
    return (
        f"Networks of `{results['case']}`, {results['samples']} loads of the test split and as "
        "many of every kind outside the training: the probability that the score of a load outside "
        "is above that of one of the test split (AUROC). Once the estimate is subtracted, the "
        f"median error is at least {min(ratios):.0f} times smaller.\n\n"
        f"{markdown_table(['network', 'score', *kinds], rows)}"
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("dataset", type=Path)
    parser.add_argument("runs", nargs="+", help="run folders, all of the dataset's case")
    parser.add_argument("--samples", type=int, default=200, help="of every kind")
    parser.add_argument("--passes", type=int, default=4, help="of stochastic networks")
    parser.add_argument("--work", type=Path, default=Path("runs/alarms"))


BENCHMARK = Benchmark(
    name="alarms",
    title="Alarms for unusual loads",
    measure=measure,
    page=page,
    arguments=arguments,
    variant=lambda options: case_of(options.dataset),
)
