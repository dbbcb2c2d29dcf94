"""One network for a family of shapes, on shapes that it has not seen.

    python -m experiments benchmark shapes

makes samples, trains a reduced network for each family, and writes its record and its page. Every
test sample has a shape of its own, and is that of the finite elements. Datasets and runs stay in
the folder `--work`.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

import surrogate
from experiments.benchmarks.benchmark import Results
from experiments.framework.factory import factory
from experiments.framework.machine import ROOT
from experiments.framework.report import markdown_table
from shared_schema import MANIFEST
from shared_schema.common import Parser
from surrogate.mechanics.statics.load import Load

TITLE = "One network for a family of shapes"
ABOUT = (
    "A reduced network with the parameters of the shape among its inputs, on shapes that it has "
    "not seen, under one load each. Errors are relative to the largest displacement, and in the "
    "mean over the shapes: the mean absolute component, and the worst node. Then: the share of "
    "the shapes whose worst node is within `--tolerance {tolerance}`; the time of a network's "
    "prediction on a shape that is known; and that of the first one within the tolerance on a new "
    "shape, with the factor of its stiffness."
)
CONFIGS = ROOT / "datagen" / "configs"
COUNTS = {"plate2d_shapes": 2000, "finger3d_shapes": 400}
TESTED = 100  # samples
EPOCHS = {"plate2d_shapes": 60, "finger3d_shapes": 200}
RANGES = "{belly: [0.0095, 0.0125], wall: [0.009, 0.011]}"
AGAIN = 5  # predictions of a known shape


def case_of(name: str, work: Path) -> str:
    """Name of a shipped case, or the file of the finger with notches of other depths and widths."""
    if name != "finger3d_shapes":
        return name
    constants = "DefineConstant[ belly = 0.011, wall = 0.010 ]; "
    constants += "// under a notch, and between notches\n"
    half = "half = (0.014 - wall) / 2; // width of a notch\nheight"
    script = (CONFIGS / "soft_finger.geo").read_text(encoding="utf-8")
    script = script.replace("belly = 0.011; height", constants + half)
    begin, end = script.index("x[] = {"), script.index("};", script.index("x[] = {"))
    middles = [f"{0.014 * k:.3f}" for k in range(1, 6)]
    x = ", ".join(f"{middle} - half, {middle} + half" for middle in middles)
    script = f"{script[:begin]}x[] = {{0, {x}, 0.076{script[end:]}"
    case = (CONFIGS / "finger3d.yaml").read_text(encoding="utf-8")
    case = case.replace("name: finger3d", f"name: {name}")
    case = case.replace("soft_finger.geo}", f"finger.geo, parameters: {RANGES}}}")
    (work / "finger.geo").write_text(script, encoding="utf-8")
    (work / "finger.yaml").write_text(case, encoding="utf-8")
    return str(work / "finger.yaml")


def trained(name: str, work: Path) -> Path:
    """Make samples of a family, and train a network on them, unless that is done."""
    work.mkdir(parents=True, exist_ok=True)
    count, (body, nodal, row) = COUNTS[name], (work / each for each in ("body", "nodal", "row"))
    share = f"dataset.test_fraction={TESTED / count}"
    factory("body", case_of(name, work), "--set", share, "--out", body)
    if not (nodal / MANIFEST).is_file():
        surrogate.sample(body, nodal, count)
    factory("structure", nodal, "--grid", "nodes", "--out", row)
    changes = [f"training.epochs={EPOCHS[name]}"]
    config = surrogate.read_config("reduced-fast", changes=changes, data=row)
    surrogate.train(config, row, work / "reduced", device="cpu")
    return row


def measured(name: str, work: Path, tolerance: float) -> Results:
    """Predict every test sample on its shape."""
    row = trained(name, work)
    test, model = surrogate.read_dataset(row).nodal_test, surrogate.load(work / "reduced")
    columns: dict[str, list[float]] = {key: [] for key in ("mean", "worst", "driven", "ms", "s")}
    family = model.geometry.shapes
    assert family is not None
    assert test.parameters is not None
    first = test.load[0]
    model.predict(first, tolerance=tolerance, pressure=pressures(model, first))  # compiles
    for number, values in enumerate(test.parameters.tolist()):
        force, u = test.load[number], test.displacement[number]
        given = dict(zip(family.names, values, strict=True))
        largest = float(np.linalg.norm(u, axis=1).max())
        began = time.perf_counter()
        shape = model.of_shape(given)
        driven = shape.predict(force, tolerance=tolerance, pressure=pressures(shape, force))
        columns["s"].append(time.perf_counter() - began)
        times = []
        for _ in range(AGAIN):
            began = time.perf_counter()
            alone = shape.predict(force)
            times.append(time.perf_counter() - began)
        columns["ms"].append(1e3 * float(np.median(times)))
        columns["mean"].append(float(np.abs(alone - u).mean()) / largest)
        for key, found in (("worst", alone), ("driven", driven)):
            columns[key].append(float(np.linalg.norm(found - u, axis=1).max()) / largest)
    found = {key: np.array(values) for key, values in columns.items()}
    return {
        "family": name,
        "parameters": dict(zip(family.names, family.ranges.tolist(), strict=True)),
        "nodes": len(model.geometry.coordinates),
        "samples": COUNTS[name] - TESTED,
        "shapes": len(found["mean"]),
        "mean_error": float(found["mean"].mean()),
        "worst_node_error": float(found["worst"].mean()),
        "largest_worst_node_error": float(found["worst"].max()),
        "within_tolerance": float((found["driven"] <= tolerance).mean()),
        "prediction_ms": float(np.median(found["ms"])),
        "first_s": float(np.median(found["s"])),
        "first_s_longest": float(found["s"].max()),
    }


def pressures(shape: surrogate.Surrogate, force: NDArray[np.float64]) -> ArrayLike | None:
    """Pressures of a sample, of a case that has some, as its forces tell them."""
    following = Load.of_samples(shape.geometry, force[None]).following
    return None if following is None else following.amplitudes[0]


def measure(options: argparse.Namespace) -> Results:
    """Measure all families."""
    families = options.families.split(",")
    rows = [measured(name, options.work / name, options.tolerance) for name in families]
    return {"tolerance": options.tolerance, "shapes": TESTED, "families": rows}


def page(results: Results) -> str:
    """Make the page."""
    return markdown_table(
        (
            "family",
            "nodes",
            "samples",
            "mean error",
            "worst node",
            "within the tolerance",
            "network [ms]",
            "new shape [s]",
        ),
        (
            (
                f"`{row['family']}`",
                str(row["nodes"]),
                str(row["samples"]),
                f"{row['mean_error']:.2%}",
                f"{row['worst_node_error']:.2%}",
                f"{row['within_tolerance']:.0%}",
                f"{row['prediction_ms']:.2g}",
                f"{row['first_s']:.2g}",
            )
            for row in results["families"]
        ),
    )


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--families", default=",".join(COUNTS), help="names, separated by commas")
    parser.add_argument("--tolerance", type=float, default=5e-3)
    parser.add_argument("--work", type=Path, default=Path("build/shapes"))
