"""Networks of README's table of results, trained with several seeds: mean and spread.

    python -m experiments benchmark seeds beam2d-mechanics-fast --data data/beam2d/structured

writes its record, or adds the seeds that its record lacks, and the page. A killed training
resumes from the folder `--work`.
"""

from __future__ import annotations

import argparse
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.benchmarks.benchmark import DOCS, Results, stored_record, without_environment
from experiments.framework.machine import ROOT, commit
from experiments.framework.record import Record, rounded
from experiments.framework.report import table_of
from shared_schema.common import InputError, Parser
from surrogate import evaluate, read_config, read_dataset, train
from surrogate.command_options import seeds
from surrogate.learning.evaluation.seeds import spread

ROW = re.compile(  # of README's table of results
    r"^\| (?P<label>`(?P<case>\w+)`[^|]*) \| \[(?P<error>[\d.]+)\]\((?P<record>\S+) "
    r"\"(?P<keys>[^\"]+)\"\) \| (?P<paper>\S+) \| (?P<minutes>\w+)(?: min)? \| "
    r"(?P<paper_minutes>\S+)(?: min)? \|$",
    re.MULTILINE,
)
KEPT = ("seed", "test", "training_seconds", "epochs", "torch")


def measure(options: argparse.Namespace) -> Results:
    """Train and evaluate the seeds that the record lacks, and sum up all of them."""
    config, data = read_config(options.config, data=options.data), read_dataset(options.data)
    same = {"config": config.plain() | {"seed": None}, "data_digest": data.manifest.digest}
    found = earlier(variant(options))
    if found and any(found[key] != value for key, value in rounded(same).items()):
        raise InputError(f"{options.config}: its record is of another configuration or dataset")
    runs = {run["seed"]: run for run in found.get("runs", ())}
    for seed in options.seeds:
        if seed not in runs:
            folder = options.work / config.name / f"seed-{seed}"
            train(config.model_copy(update={"seed": seed}), data, folder, device="cpu")
            evaluation = evaluate(folder, data, device="cpu")
            evaluation.write()
            runs[seed] = kept(evaluation.content)
    all_runs = [runs[seed] for seed in sorted(runs)]
    return {**same, "runs": all_runs, "spread": spread(all_runs)}


def earlier(name: str) -> Results:
    """Results of the record of a configuration; empty if there is none."""
    try:
        return stored_record(f"seeds-{name}").findings.numbers
    except FileNotFoundError:
        return {}


def kept(content: Mapping[str, Any]) -> Results:
    """What the record keeps of an evaluation."""
    found = {key: content[key] for key in KEPT} | {"commit": commit()}
    if "uncertainty" in content:
        found["uncertainty"] = {"intervals": content["uncertainty"]["intervals"]}
    return found


def page(results: Results) -> str:
    """Make what the page says of one record: a line for each seed."""
    of = results["spread"]
    return table_of(
        results["runs"],
        {
            "seed": "{seed}",
            "ē, 10⁻³ m": lambda run: fixed(run["test"]["mean_error"], of["mean_error"]),
            "σ(e)": lambda run: fixed(run["test"]["std_error"], of["std_error"]),
            "inside the 95 % intervals": inside,
            "training, min": lambda run: f"{run['training_seconds'] / 60:.1f}",
        },
    )


def inside(run: Mapping[str, Any]) -> str:
    """Share of the components inside the 95 % intervals of a network that has them."""
    intervals = run.get("uncertainty", {}).get("intervals", ())
    return (
        "".join(f"{100 * of['coverage']:.1f} %" for of in intervals if of["level"] == 0.95) or "–"
    )


def overview(records: Sequence[Record]) -> str:
    """Make README's table with the spread over the seeds, and where its numbers are from."""
    rows = [row.groupdict() for row in ROW.finditer((ROOT / "README.md").read_text())]
    rows = [row | {"record": row["record"].removeprefix("docs/")} for row in rows]
    over = {record.experiment.partition("seeds-")[2]: record.findings.numbers for record in records}

    def of_seeds(write: Callable[[Results], str]) -> Callable[[dict[str, str]], str]:
        return lambda row: write(over[name]) if (name := Path(row["record"]).stem) in over else "–"

    def same_data(row: dict[str, str]) -> str:
        digest = record_of(row).get("data_digest")
        return of_seeds(lambda of: "same" if of["data_digest"] == digest else "other")(row)

    spreads = table_of(
        rows,
        {
            "network": "{label}",
            "seeds": of_seeds(lambda numbers: str(len(numbers["runs"]))),
            "ē, 10⁻³ m": of_seeds(lambda numbers: mean_and_std(numbers["spread"]["mean_error"])),
            "range": of_seeds(lambda numbers: ends(numbers["spread"]["mean_error"])),
            "README, seed 0": "{error}",
            "its dataset": same_data,
            "paper": "{paper}",
        },
    )
    sources = table_of(
        rows,
        {
            "network": "{label}",
            "ē here": "{error}: [record](../{record}) `{keys}`",
            "training here": training_source,
            "paper": paper_source,
            "commands": commands,
        },
    )
    return f"{spreads}\n## Where README's numbers are from\n\n{sources}"


def mean_and_std(of: Mapping[str, Any]) -> str:
    """Write mean ± standard deviation in 10⁻³ m; the mean alone of one seed."""
    mean = fixed(of["mean"], of)
    return f"{mean} ± {fixed(of['std'], of)}" if of["std"] else mean


def ends(of: Mapping[str, Any]) -> str:
    """Write the smallest and the largest value in 10⁻³ m."""
    return f"{fixed(of['min'], of)} to {fixed(of['max'], of)}"


def fixed(metres: float, of: Mapping[str, Any]) -> str:
    """Write a length in 10⁻³ m to the second digit of the standard deviation, or of one seed."""
    digits = 1 - math.floor(math.log10(1e3 * (of["std"] or of["mean"])))
    return f"{1e3 * metres:.{max(0, digits)}f}"


def record_of(row: Mapping[str, str]) -> dict[str, Any]:
    """Read the record that a row of README links to."""
    content: dict[str, Any] = json.loads((DOCS / row["record"]).read_text())
    return content


def training_source(row: Mapping[str, str]) -> str:
    """Key of the training time of a row of README."""
    if "training_seconds" in record_of(row):
        return f"{row['minutes']} min: `training_seconds`"
    return row["minutes"] if row["minutes"] == "none" else f"{row['minutes']} min: no record"


def paper_source(row: Mapping[str, str]) -> str:
    """Key of the paper's numbers of a row of README."""
    if row["paper"] == "–":
        return "–"
    likelihood = "variational_bayes" if "-vb-" in row["record"] else "deterministic"
    return f"{row['paper']}, {row['paper_minutes']} min: `{row['case']}/{likelihood}`"


def commands(row: Mapping[str, str]) -> str:
    """Commands that make the record of a row of README again."""
    content = record_of(row)
    listed = content["commands"] if "commands" in content else [content["command"]]
    return "<br>".join(f"`{without_environment(command)}`" for command in listed)


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("config", metavar="CONFIG", help="name of a recipe for the case")
    parser.add_argument("--data", type=Path, required=True, metavar="DIR", help="its dataset")
    parser.add_argument("--seeds", type=seeds, default="0:5", metavar="A:B", help="from A to B - 1")
    parser.add_argument("--work", type=Path, default=Path("runs/seeds"), help="folder of the runs")


def variant(options: argparse.Namespace) -> str:
    """End of the name of the record."""
    return Path(options.config).stem


TITLE = "Several seeds"
ABOUT = (
    "README's table of results has single runs, of "
    "seed 0, some of earlier versions and datasets. Here the same recipes are trained with several "
    "seeds, which draw the initial weights, the validation samples and the order of the batches; "
    "the dataset stays. ē is the mean error on its test split: mean ± standard deviation over the "
    "seeds (with n − 1), and range. The paper has one number of each; the second table has its "
    "keys in [paper.yaml](../../experiments/paper/paper.yaml). Trainings ran on one thread, beside "
    "other work, which bears on their times. Load series without a network have no seed."
)
PART = "`{config[name]}`"
