"""The shipped liver with every cell divided: time and memory from the case to predictions.

    python -m experiments benchmark refined-liver --refine 1

writes its record and its page. What is solved and trained stays in the folder, and is used again.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.benchmark import Results
from experiments.benchmarks.page import measure_page
from experiments.framework.machine import ROOT
from experiments.framework.report import markdown_table
from experiments.framework.timing import Timing, median_seconds
from shared_schema.common import Parser, WorkError, largest_resident
from surrogate import Surrogate, load, read_dataset
from tests.surrogate.page.browser import chromium

CASE, LIMIT, SEED = "liver3d", 500.0, 5  # body forces in N/m³ of predictions that are timed
TOLERANCE, LOADS, MOVES = 5e-3, 20, 240
Array = NDArray[np.float64]
DATAGEN = ROOT / ".venv-datagen" / "bin" / "python"
RANKS = "mpirun", "-n", "2"
LASTING = "data", "structure", "train"  # parts that are not made again
FEW = Timing(repeats=20, seconds=20)


class Steps:
    """Commands in a folder, with the time and the memory that each takes.

    What is there already is not made again: such a part keeps the time of before.

    Parameters
    ----------
    folder : Path
        Made if it is not there.
    refine : int
        Of the mesh.
    """

    def __init__(self, folder: Path, refine: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.refine, self.taken = folder, refine, Results()
        self._times = folder / "times.json"
        before = json.loads(self._times.read_text()) if self._times.exists() else {}
        self._before = {part: taken for part, taken in before.items() if part in LASTING}

    def take(self, part: str, program: str, *words: str, ranks: bool = False) -> None:
        """Execute a command of one of the programs."""
        python = str(DATAGEN) if program == "datagen" else sys.executable
        command = [python, "-m", f"{program}.command_line", *words]
        began = perf_counter()
        with (self.folder / f"{part}.log").open("w") as log:
            process = subprocess.Popen(
                [*(RANKS if ranks else ()), *command], cwd=self.folder, stdout=log, stderr=log
            )
            _, status, usage = os.wait4(process.pid, 0)
        if status:
            raise WorkError(f"{part}: see {log.name}")
        memory = None if ranks else round(usage.ru_maxrss / 1e3)
        taken = {"s": round(perf_counter() - began, 1), "mb": memory}
        before = self._before.get(part, taken)
        self.taken[part] = max(taken, before, key=lambda each: float(each["s"]))
        self._times.write_text(json.dumps(self._before | self.taken))
        print(part, self.taken[part], file=sys.stderr)

    def make_series(self) -> None:
        """Make the body, and its load series without a sample."""
        self.take("body", "datagen", "body", *self.case, "--out", "body")
        self.take("ready", "surrogate", "train", "series", "--data", "body", "--out", "series")

    @property
    def case(self) -> tuple[str, ...]:
        """The case, for commands of `datagen`."""
        return CASE, "--set", f"mesh.refine={self.refine}"


def measure(options: argparse.Namespace) -> Results:
    """Go all the way."""
    steps = Steps(options.folder, options.refine)
    force = ",".join(f"{value:g}" for value in forces_per_volume()[0])
    out = ("--out", "solved.npz")
    steps.take("solve", "datagen", "solve", *steps.case, "--body-force", force, *out, ranks=True)
    results: Results = {key: getattr(options, key) for key in ("refine", "samples", "limit")}
    if not options.without_series:
        steps.make_series()
        words = ("predict", "series", "--body-force", force, "--certify", "--out", "predicted.npz")
        tolerance = TOLERANCE * largest_of(steps.folder / "solved.npz")
        steps.take("certified", "surrogate", *words, "--tolerance", f"{tolerance:.3g}")
        parts = ("body", "ready", "certified")
        results["first_certified_s"] = round(sum(steps.taken[part]["s"] for part in parts), 1)
    milder = "--set", f"load.range=[-{options.limit}, {options.limit}]"
    few = ("--samples", str(options.samples), "--set", "dataset.test_fraction=0.2", *milder)
    steps.take("data", "datagen", "run", *steps.case, *few, "--out", "nodal", ranks=True)
    grid = ("--grid", "nodes", "--out", "structured")
    steps.take("structure", "datagen", "structure", "nodal", *grid)
    modes = min(96, options.samples // 2)
    network = ("--set", "network.input_modes=3", "--set", f"network.output_modes={modes}")
    train = ("train", f"{CASE}-reduced-fast", "--data", "structured", "--out", "reduced")
    steps.take("train", "surrogate", *train, *network, "--set", f"training.epochs={options.epochs}")
    results["reduced"] = predictions(steps.folder / "reduced", surface=True)
    steps.take("page", "surrogate", "page", "reduced", "--out", "page.html")
    with chromium() as browser:
        results["page"] = measure_page(browser, steps.folder / "page.html", 0, MOVES, openings=3)
    dataset = read_dataset(steps.folder / "structured")
    truth = dataset.nodal_test
    results["nodes"] = len(dataset.geometry.coordinates)
    results["surface_nodes"] = len(dataset.geometry.nodes_of("surface"))
    results["test_samples"] = len(truth.force)
    of_series = None if options.without_series else steps.folder / "series"
    for name, folder in (("reduced", steps.folder / "reduced"), ("series", of_series)):
        if folder is not None:
            model = load(folder)
            results.setdefault(name, {})["error"] = errors(model, truth.force, truth.displacement)
    if of_series is not None:
        results["series"] |= predictions(of_series, surface=False)
    return results | {"parts": steps.taken, "factor": factor_of(load(steps.folder / "reduced"))}


def forces_per_volume() -> Array:
    """Body forces in N/m³, (LOADS, 3)."""
    return np.random.default_rng(SEED).uniform(-LIMIT, LIMIT, (LOADS, 3))


def largest_of(solution: Path) -> float:
    """Largest displacement in m."""
    with np.load(solution) as fields:
        return float(np.linalg.norm(fields["displacement"], axis=1).max())


def predictions(run: Path, surface: bool) -> Results:
    """Median times in ms of predictions by one run, and its memory."""
    began = perf_counter()
    model = load(run)
    found: Results = {"load_s": round(perf_counter() - began, 1)}
    volume = np.array([model.solve(body_force=tuple(b)).force for b in np.eye(3)])
    forces = np.einsum("nk,kai->nai", forces_per_volume(), volume)
    number = iter(range(10**9))

    def each(predict: Callable[[Array], object]) -> float:
        seconds = median_seconds(lambda: predict(forces[next(number) % LOADS]), FEW)
        return float(f"{1e3 * seconds:.3g}")

    found["all_ms"] = each(model.predict)
    if surface:
        found["surface_ms"] = each(lambda f: model.predict(f, nodes="surface"))
    else:
        found["driven_ms"] = each(lambda f: model.predict(f, tolerance=TOLERANCE))
    predicted = model.predict(forces[:1])
    found["fast_estimate_ms"] = each(lambda f: model.fast_estimate(f[None], predicted))
    return found | {"memory_mb": round(largest_resident() / 1e6)}


def errors(model: Surrogate, force: Array, truth: Array) -> Results:
    """Mean error of a component in 10⁻⁵ m, and largest error of a node over the displacement."""
    error = model.predict(force) - truth
    largest = np.linalg.norm(error, axis=2).max(axis=1) / np.linalg.norm(truth, axis=2).max(axis=1)
    return {
        "mean_1e-5_m": float(f"{1e5 * np.abs(error).mean():.3g}"),
        "median_largest_percent": float(f"{100 * np.median(largest):.3g}"),
    }


def factor_of(model: Surrogate) -> str:
    """What solves with the stiffness of the body."""
    linear = model.network.linear
    assert linear is not None
    factor = linear.compliance.factor
    return getattr(factor, "title", "band") if factor is not None else "dense"


PARTS = {
    "solve": "one solution, two ranks",
    "body": "the body of a case without samples",
    "ready": "its load series",
    "certified": "first prediction within 0.5 %, with full certificate",
    "data": "samples, two ranks",
    "structure": "their nodes in a row",
    "train": "training of the reduced network",
    "page": "its page",
}


def page(results: Results) -> str:
    """Make the page."""
    parts = [
        (title, f"{taken['s']:.1f} s", "–" if taken["mb"] is None else f"{taken['mb']} MB")
        for name, title in PARTS.items()
        if (taken := results["parts"].get(name))
    ]
    reduced, series = results["reduced"], results.get("series")
    rows = [
        ("reduced network, all nodes", f"{reduced['all_ms']:.3g} ms", errors_of(reduced)),
        ("reduced network, surface", f"{reduced['surface_ms']:.3g} ms", ""),
    ]
    if series:
        rows += [
            ("load series", f"{series['all_ms']:.3g} ms", errors_of(series)),
            ("load series, directions to 0.5 %", f"{series['driven_ms']:.3g} ms", ""),
        ]
    rows.append(("fast estimate of the error", f"{reduced['fast_estimate_ms']:.3g} ms", ""))
    first = ""
    if series:
        first = (
            f"From the case to the first certified prediction, without a sample: "
            f"**{results['first_certified_s']:.0f} s**. "
        )
    return (
        f"`mesh.refine: {results['refine']}`, {results['surface_nodes']} nodes on the surface. "
        f"{results['samples']} samples under ±{results['limit']:g} N/m³, of which "
        f"{results['test_samples']} are for the test. {first}{results['factor']} factorises.\n\n"
        f"{markdown_table(('part', 'time', 'memory'), parts)}\n"
        f"{markdown_table(('prediction', 'time', 'error on the test samples'), rows)}"
        f"{of_page(results['page']) if 'page' in results else ''}"
    )


def of_page(found: Results) -> str:
    """Describe the page of the reduced network."""
    ready, places = found["ready_ms"] / 1e3, found["places"]
    low, middle, high = found["frame_ms"]
    return (
        f"\nIts page is ready {ready:.1f} s after it is opened in Chromium without a graphics "
        f"processor. A frame of a drag at {places} places takes {middle:.3g} ms (10 to 90 %: "
        f"{low:.3g} to {high:.3g}), most of it for drawing.\n"
    )


def errors_of(found: Results) -> str:
    """Error of a component, and of the worst node."""
    error = found["error"]
    return (
        f"{error['mean_1e-5_m']:.3g}·10⁻⁵ m in the mean; largest of a node "
        f"{error['median_largest_percent']:.3g} % (median)"
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--refine", type=int, default=1, help="divisions of each cell (default 1)")
    parser.add_argument("--samples", type=int, default=60, help="solutions (default 60)")
    parser.add_argument(
        "--limit",
        type=float,
        default=LIMIT,
        help=f"of the body forces of samples in N/m³ (default {LIMIT:g})",
    )
    parser.add_argument("--epochs", type=int, default=200, help="of the training (default 200)")
    parser.add_argument("--without-series", action="store_true", help="only the reduced network")
    folder = Path("build/refined-liver")
    parser.add_argument("--folder", type=Path, default=folder, help=f"default {folder}")


def variant(options: argparse.Namespace) -> str:
    """End of the name of the record."""
    return str(options.refine)


TITLE = "Refined livers: from the case to predictions"
ABOUT = (
    f"`{CASE}` with all cells divided. Times of the one solution and of predictions are under "
    f"body forces of ±{LIMIT:g} N/m³, those of single predictions medians over {LOADS} loads. "
    "Two ranks solve."
)
PART = "{nodes} nodes"
