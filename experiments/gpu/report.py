"""The page of what was measured on GPUs, from the records of the steps.

python -m experiments gpu report docs/results/gpu docs/gpu-results.md
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from experiments.framework.record import Record, read_record
from experiments.framework.report import markdown_table, table_of
from experiments.gpu.setting import Results
from experiments.paper.published_numbers import PAPER
from shared_schema.common import InputError, write_text

BEGINNING = """# Measured on a GPU

Made by `python -m experiments gpu report docs/results/gpu docs/gpu-results.md` from the records
beside it ([what is measured, and how](gpu.md)). Steps that are not here have not been measured.
"""


LIKELIHOODS = {
    "deterministic": "deterministic",
    "maximum_likelihood": "maximum likelihood",
    "variational_bayes": "variational Bayes",
}


def write_report(records: Path, path: Path) -> None:
    """Write the page of a folder of records."""
    write_text(path, page(read_records(records)))


def read_records(folder: Path) -> dict[str, Record]:
    """Records by step; InputError if there is none."""
    found = {path.stem: read_record(path) for path in sorted(folder.glob("*.json"))}
    records = {name: record for name, record in found.items() if record is not None}
    if not records:
        raise InputError(f"'{folder}': expected records of steps")
    return records


def page(records: Mapping[str, Record]) -> str:
    """Make the page."""
    parts = [BEGINNING]
    for step, (title, text) in SECTIONS.items():
        names = [name for name in records if name == step or name.startswith(f"{step}-")]
        if names:
            found = [records[name] for name in names]
            card = found[0].machine["hardware"].partition(",")[0]
            listed = ", ".join(f"`{name}`" for name in names)
            content = text(*(record.findings.numbers for record in found))
            parts.append(f"## {title}\n\n{content}\n{card}; {listed}.\n")
    return "\n".join(parts)


def training(numbers: Results) -> str:
    """Samples per second of the plain loop and ours."""
    ways = list(dict.fromkeys(r["way"] for r in numbers["training"]))
    rates: dict[tuple[str, str], dict[str, str]] = {}
    for r in numbers["training"]:
        of = rates.setdefault((r["network"], f"{r['batch']}"), {})
        of[r["way"]] = f"{r['samples_per_second']:.0f}"
    rows = ((*which, *(of.get(way, "–") for way in ways)) for which, of in rates.items())
    return (
        "Samples a second by loop. The plain loop is that of PyTorch's tutorials, whose "
        "convolutions use TF32; networks, loss and optimiser are the same in all.\n\n"
        + markdown_table(("network", "batch", *ways), rows)
    )


def of_channels(numbers: Results) -> str:
    """What the paper's recipe reaches on the 2D beam with another norm, and when it is over."""
    last, epochs = numbers["curve"][-1], numbers["config"]["training"]["epochs"]
    rate = last["samples_per_second"]
    whole = epochs * numbers["train_samples"] / rate / 60
    return (
        "The paper's recipe on the 2D beam with `batch_norm: channels`, at a constant rate.\n"
        f"{numbers['epochs']} of {epochs} epochs of batches of "
        f"{numbers['config']['training']['batch_size']} in {numbers['training_seconds']:.0f} s, "
        f"compilation among it: ē = {1e3 * numbers['test']['mean_error']:.2f}e-3 m.\nAt the "
        f"{rate:.0f} samples a second of the last epoch, all of them take {whole:.1f} min "
        "(the paper: 131 min on a V100).\n\n"
        f"The training loss is {_loss_after(numbers, 0.1):.4f} after a tenth of the epochs and "
        f"{last['train_loss']:.4f} at the end: [batch norm in batches of four]"
        "(how-to/recipe.md) holds it there.\n"
    )


def last_axis(*trainings: Results) -> str:
    """What the paper's recipe reaches, as far as the time went."""
    return (
        "Batch norm of the last axis, TF32, compiled. The recipe has 600 epochs, which take the\n"
        "paper 131 min (beam), 226 min (variational Bayes) and 78 min (L-shape) on a V100.\n\n"
        + _reached(trainings)
    )


def without_norm(*trainings: Results) -> str:
    """What it reaches without batch norm and at a constant rate."""
    return (
        "The same recipe with `batch_norm: false`, TF32, compiled; four trainings at once on one "
        "card, by NVIDIA's\nMPS ([how](gpu.md#several-trainings-at-once)). The time ended them: "
        "the paper's recipe has 600 epochs, in\n131 min (beam), 226 min (variational Bayes) and "
        "78 min (L-shape) on a V100.\n\n" + _reached(trainings)
    )


def _reached(trainings: Sequence[Results]) -> str:
    """Epochs, times and errors of trainings, beside the paper's."""
    rows = []
    for numbers in trainings:
        config = numbers["config"]
        published = PAPER.network(config["case"], config["likelihood"])
        intervals = numbers.get("uncertainty", {}).get("intervals", [])
        covered = [f"{100 * i['coverage']:.1f} %" for i in intervals if i["level"] == 0.95]
        rows.append(
            (
                f"{config['case']}, {LIKELIHOODS[config['likelihood']]}",
                f"{numbers['epochs']}",
                f"{numbers['training_seconds'] / 60:.1f} min",
                f"{1e3 * numbers['test']['mean_error']:.2f}e-3 m",
                "-" if published is None else f"{published.mean_error_mm:g}e-3 m",
                *(covered or ["-"]),
            )
        )
    head = ("network", "epochs", "time", "ē", "ē of the paper", "in 95 % intervals")
    return markdown_table(head, rows)


def _loss_after(numbers: Results, share: float) -> float:
    """Training loss after a share of the epochs."""
    reached = share * numbers["config"]["training"]["epochs"]
    return float(next(e["train_loss"] for e in numbers["curve"] if e["epoch"] >= reached))


def predictions(numbers: Results) -> str:
    """Times of U-Nets, of one load and of the largest batch."""
    table = table_of(
        [r for r in numbers["latencies"] if "float32_ms" in r and r["batch"] in (1, 4096)],
        {
            "network": "{case}, {recipe}",
            "passes": "{passes}",
            "loads": "{batch}",
            "float32": "{float32_ms:.3g} ms",
            "TF32": "{tensorfloat32_ms:.3g} ms",
            "difference": "{relative_difference:.0e}",
        },
    )
    return (
        "Networks of random weights, arrays in and out. 300 passes are those of variational Bayes, "
        'each with its own\nweights, which stay on the card. TF32 is `load(RUN, "cuda", '
        'precision="tensorfloat32")`; its difference\nfrom float32 is relative to the largest '
        "displacement.\n\n" + table
    )


def package(numbers: Results) -> str:
    """Times of the package's networks, of one load and of the largest batch."""
    largest = {r["name"]: r["batch"] for r in numbers["responses"]}  # batches grow
    table = table_of(
        [r for r in numbers["responses"] if r["batch"] in (1, largest[r["name"]])],
        {
            "network": "`{name}`",
            "loads": "{batch}",
            "prediction": "{predict_ms:.3g} ms",
            "fast bounds": "{bounds_ms:.3g} ms",
            "directions": "{directions_ms:.3g} ms",
            "difference": "{relative_difference:.0e}",
        },
    )
    return (
        f"Loads on 1 to 4 nodes, arrays in and out; {numbers['responses'][0]['directions']} "
        "directions, as an exported file has them. The difference\nfrom the CPU's predictions is "
        "relative to the largest displacement.\n\n" + table
    )


def organs(*found: Results) -> str:
    """Frames a second."""
    table = table_of(
        [r for numbers in found for r in numbers["frames"]],
        {
            "run": "`{run}`",
            "nodes": "{nodes}",
            "one solution": "{solve_ms:.3g} ms",
            "prediction": "{predict_ms:.3g} ms",
            "with fast bound": "{with_bound_ms:.3g} ms",
            "frames / s": "**{frames_per_second:.0f}**",
            "ready after": lambda r: (
                f"{r['load_s'] + r['first_prediction_s'] + r['first_estimate_s']:.1f} s"
            ),
            "memory": lambda r: f"{r['peak_memory_bytes'] / 1e9:.1f} GB",
        },
    )
    return (
        "The liver, refined once and twice, under body forces, and unrefined with touches; one "
        "load after the other,\nwith the fast bound of each prediction (its estimate before "
        "calibration where `surrogate calibrate` has not\nrun). One solution is one with the "
        "stiffness of the body at rest.\n\n" + table
    )


def tests(numbers: Results) -> str:
    """Tests on the device."""
    ended = ", before the time ended" if numbers.get("timed_out") else ""
    return f"{numbers['passed']} of {numbers['tests']} tests that are marked `gpu` pass{ended}.\n"


SECTIONS: dict[str, tuple[str, Callable[..., str]]] = {
    "throughput": ("Training", training),
    "last-axis": ("The paper's recipe", last_axis),
    "paper-beam2d-det": ("Batch norm of the channels", of_channels),
    "without-norm": ("The paper's recipe without batch norm", without_norm),
    "latency": ("Predictions of U-Nets", predictions),
    "responses": ("Networks of the package", package),
    "frames": ("Organs", organs),
    "gpu-tests": ("Tests", tests),
}
