"""Summary of a dataset: names and values, all text."""

from __future__ import annotations

from collections import Counter, defaultdict
from pathlib import Path

import numpy as np

from datagen.discretisation.element import element_kind
from shared_schema.actuators import KINDS, UNITS, actuators_of
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.bodies.shape_family import NAMES, RANGES
from shared_schema.common.machine import megabytes
from shared_schema.common.units import Units
from shared_schema.dataset_reader import DatasetReader, unstable_samples
from shared_schema.layout import NO_NODE, Arrays
from shared_schema.manifest import Manifest, find_unfinished, growing
from shared_schema.motion import TimeSettings

Row = tuple[str, str]

COUNTS = ("load_steps", "cutbacks", "newton_iterations")
ACTUATED = ("actuation", "amplitude", "quantity")


@checked_arguments
def info(dataset: Path | str) -> dict[str, str]:
    """Describe a dataset: samples, failures by reason, solver effort, ranges.

    Parameters
    ----------
    dataset : Path or str
        Folder of a nodal or structured dataset.

    Returns
    -------
    dict of str to str
        Values by their names, in the order of ``datagen info``.

    Raises
    ------
    InputError
        If there is no intact dataset.
    """
    folder = Path(dataset)
    reader = DatasetReader(folder)
    rows = _common(reader.manifest, reader.body)
    rows += _solver(reader.manifest)
    rows += _elements(reader) + _motion(reader)
    unstable = reader.unstable()
    if unstable is not None:
        rows.append(("stability", unstable_samples(unstable)))
    rows += _nodal(reader) if reader.manifest.kind == "nodal" else _structured(reader.manifest)
    growth = find_unfinished(folder)
    if growth is not None:
        rows.insert(2, ("unfinished", growing(growth)))
    return dict(rows)


def _common(manifest: Manifest, body: Arrays) -> list[Row]:
    nodes, dimension = body["mesh/coordinates"].shape
    return [
        ("dataset", f"{manifest.name}, {manifest.kind}, schema version {manifest.schema_version}"),
        ("samples", f"{manifest.samples} solved, {manifest.failed} failed"),
        *(
            (f"grown from {stage.samples + stage.failed}", f"digest {stage.digest}")
            for stage in manifest.history
        ),
        ("shards", str(len(manifest.shards))),
        ("seed", str(manifest.seed)),
        ("mesh", f"{nodes} nodes, {len(body['mesh/cells'])} cells, {nodes * dimension} DOFs"),
        *(
            (f"parameter {name}", f"{low:g} to {high:g}")
            for name, (low, high) in zip(body.get(NAMES, ()), body.get(RANGES, ()), strict=True)
        ),
        (
            "clamped / loadable nodes",
            f"{body['mesh/clamped'].sum()} / {body['mesh/loadable'].sum()}",
        ),
        ("made by", ", ".join(f"{k} {v}" for k, v in manifest.software.items())),
        ("digest", manifest.digest),
    ]


def _elements(reader: DatasetReader) -> list[Row]:
    """How distributed loads act, if the elements have points between the nodes."""
    element = reader.manifest.case.get("element", "linear")
    if element_kind(element, reader.cell_type).corners_only:
        return []
    where = "all points of the elements"
    if reader.manifest.forces is None:
        where = "the corners of the cells alone, as in datasets of earlier versions"
    return [("distributed loads on", where)]


def _motion(reader: DatasetReader) -> list[Row]:
    """Frames and scheme, if the samples are motions."""
    content = reader.manifest.case.get("time")
    if content is None:
        return []
    settings = TimeSettings.model_validate(content)
    return [
        (
            "motion",
            f"{len(settings.frames)} frames to {settings.steps * settings.step:g} s, "
            f"{settings.steps} steps, {settings.scheme}",
        )
    ]


def _solver(manifest: Manifest) -> list[Row]:
    """How the samples were solved, where the manifest says it."""
    solver = manifest.solver
    if solver is None:
        return []
    element = manifest.case.get("element", "linear")
    memory = "" if solver.memory is None else f", {megabytes(solver.memory)} a rank at most"
    return [
        ("elements", f"{element}, {solver.unknowns} unknowns"),
        ("linear solver", solver.linear_solver + memory),
    ]


def _nodal(reader: DatasetReader) -> list[Row]:
    """Rows of a nodal dataset; one shard at a time is in memory, and some numbers a sample."""
    reasons: Counter[str] = Counter()
    loads = np.zeros(len(reader.body["mesh/coordinates"]), dtype=np.int64)
    columns: dict[str, list[np.ndarray]] = defaultdict(list)
    for _, arrays in reader:
        reasons.update(str(reason) for reason in arrays["failed/reason"])
        if len(arrays["samples/number"]) == 0:
            continue
        nodes, force = arrays["samples/loaded_nodes"], arrays["samples/force"]
        loads += np.bincount(nodes[nodes != NO_NODE], minlength=len(loads))
        columns["force"].append(np.array([force.min(), force.max()]))
        columns["moved"].append(np.linalg.norm(arrays["samples/displacement"], axis=2).max(axis=1))
        for name in (*COUNTS, "residual_norm", "wall_time", *ACTUATED):
            columns[name].append(arrays.get(f"samples/{name}", np.zeros((1, 0))))
    rows = [(f"failed: {reason}", str(count)) for reason, count in reasons.most_common()]
    if reader.manifest.samples == 0:
        return rows
    of = {name: np.concatenate(values) for name, values in columns.items()}
    units = Units.of_case(reader.manifest.case)
    per_node, wall = loads[loads > 0], of["wall_time"]
    return [
        *rows,
        ("samples per loaded node", f"{per_node.min()} to {per_node.max()}"),
        ("force components", f"{of['force'].min():.4g} to {of['force'].max():.4g} {units.force}"),
        (
            "largest |u| of a sample",
            f"median {np.median(of['moved']):.4g}, max {of['moved'].max():.4g} {units.length}",
        ),
        *_actuators(reader.manifest, units, *(of[name] for name in ACTUATED)),
        ("load steps", _mean_and_max(of["load_steps"])),
        ("cutbacks", _mean_and_max(of["cutbacks"])),
        ("Newton iterations", _mean_and_max(of["newton_iterations"])),
        ("largest residual", f"{of['residual_norm'].max():.3g} {units.force}"),
        (
            "solve time",
            f"{wall.sum():.4g} s in all, median {np.median(wall) * 1e3:.4g} ms a sample",
        ),
    ]


def _actuators(manifest: Manifest, units: Units, *columns: np.ndarray) -> list[Row]:
    """What is given and found of each actuator."""
    rows, known = [], actuators_of(manifest.case.get("actuators") or {})
    for number, (name, actuator) in enumerate(known.items()):
        amplitude, quantity = UNITS[KINDS[actuator.kind][1]]
        values = zip(
            (actuator.kind, amplitude[0], quantity[0]),
            columns,
            (KINDS[actuator.kind][0], amplitude[1], quantity[1]),
            strict=True,
        )
        said = {
            f"{what} {of[:, number].min():.4g} to {of[:, number].max():.4g} {units.named(unit)}"
            for what, of, unit in values
        }
        rows.append((f"actuator {name}", ", ".join(sorted(said))))
    return rows


def _structured(manifest: Manifest) -> list[Row]:
    structured = manifest.structured
    assert structured is not None
    units = Units.of_case(manifest.case)
    shape = " x ".join(str(n) for n in structured.grid_shape)
    grid = [("grid", shape)]
    if structured.embedding is not None:
        mean, largest = structured.embedding.mean_error, structured.embedding.max_error
        grid = [
            ("grid", f"{shape}, embedded on the mesh"),
            ("to the grid and back", f"{mean:.2%} in the mean, {largest:.2%} at most"),
        ]
    std = ", ".join(f"{s:.4g}" for s in structured.displacement.std) + f" {units.length}"
    return [
        *grid,
        ("split", f"{structured.train} train, {structured.test} test"),
        *([("std of displacement", std)] if manifest.samples else []),
        ("source digest", structured.source_digest),
    ]


def _mean_and_max(values: np.ndarray) -> str:
    return f"mean {values.mean():.2f}, max {values.max()}"
