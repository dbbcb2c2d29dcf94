"""Report of a run: a self-contained HTML page with its figures, and numbers beside published ones.

The text of the page stands in ``report.html.j2``; Jinja escapes every value in it.
"""

from __future__ import annotations

import logging
from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from jinja2 import Environment, FileSystemLoader, StrictUndefined, UndefinedError
from pydantic import Field

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.configuration import Frozen, read_yaml, validate
from shared_schema.common.errors import InputError, first_line
from shared_schema.common.files import require_writable, write_text
from shared_schema.common.units import Units
from shared_schema.dataset_reader import DatasetReader
from surrogate.learning.runs.description import RunDescription
from surrogate.learning.runs.folder import RunFolder, read_mapping
from surrogate.learning.runs.shelf import find_run

Row = tuple[str, ...]  # name, value here, and the published one beside published numbers
FIGURES = (
    (
        "deformed.png",
        "A test load at the free end: the predicted deformed mesh (blue) over that of the "
        "finite elements (red), and the undeformed mesh (grey, dashed).",
    ),
    (
        "error_field.png",
        "The same load: distance between predicted and reference position of every node, "
        "interpolated over the elements, on the predicted mesh.",
    ),
    (
        "errors.png",
        "Mean error of every test sample over the displacement magnitude at its loaded node, with "
        "the least-squares line; dashed, the mean over the test split.",
    ),
    (
        "von_mises.png",
        "The same load: von Mises stresses that follow from the predicted displacements, and those "
        "of the finite elements.",
    ),
    (
        "uncertainty_field.png",
        "The same load: predicted standard deviation of every node's position.",
    ),
    (
        "calibration.png",
        "Share of the test split's displacement components that predicted central intervals of "
        "every level cover; on the dashed line they are as wide as they should be.",
    ),
    (
        "error_against_uncertainty.png",
        "Error of every node of every test sample over its predicted standard deviation.",
    ),
    (
        "sweep.png",
        "Forces of a sweep at one node, those of the training shaded: displacement there with its "
        "95 % band, and the error within it.",
    ),
    ("loss.png", "Loss over the epochs, on the training samples and on those kept for validation."),
)
logger = logging.getLogger(__name__)
PAGES = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


class Published(Frozen):
    """Published numbers of a network of the same case; by default there are none.

    Attributes
    ----------
    heading : str
        Heading of their column in a report, such as ``paper``.
    source : str
        Sentence that says where they are published.
    example_displacement : float, optional
        Tip displacement in m of the sample that the publication shows; the evaluation shows the
        test sample whose tip displacement is nearest.
    numbers : dict of str to str
        Published numbers by the name of the report's row, such as ``training time: 131 min``.
    """

    heading: str = "published"
    source: str = ""
    example_displacement: float | None = None
    numbers: dict[str, str] = Field(default_factory=dict)


@checked_arguments
def read_published(path: str | Path) -> Published:
    """Read published numbers from a YAML file.

    Raises
    ------
    InputError
        If the file is missing or a key or value in it is wrong.
    """
    return validate(Published, read_yaml(Path(path)), str(path))


@dataclass(frozen=True)
class Figure:
    """A figure of the page.

    Attributes
    ----------
    caption : str
    source : str
        Data URI of the PNG.
    """

    caption: str
    source: str


@dataclass(frozen=True)
class Solving:
    """Cost of the equilibria that the run's data came from.

    Attributes
    ----------
    solved, failed : int
        Number of load cases.
    seconds : float
        Wall time of all solved load cases together.
    software : dict
        Versions by name.
    """

    solved: int
    failed: int
    seconds: float
    software: dict[str, str]


@checked_arguments
def write_report(
    run: str | Path,
    out: str | Path,
    *,
    nodal: str | Path | None = None,
    published: Published | None = None,
    against: str | Path | None = None,
) -> None:
    """Write the report of an evaluated run.

    Parameters
    ----------
    run : str or Path
        Folder of an evaluated run, or the name of a network that comes with the package.
    out : str or Path
        HTML file to write.
    nodal : str or Path, optional
        Nodal dataset from which the run's data was made; adds the time of the equilibria.
    published : Published, optional
        Published numbers, shown beside those of the run.
    against : str or Path, optional
        ``evaluation.json`` of another run, or a record that holds it, whose numbers are shown too.

    Raises
    ------
    InputError
        If the run or the other one is not evaluated, its data was made from another nodal dataset,
        or the report has no row of the name of a published number.
    """
    folder, path = RunFolder(find_run(run)), Path(out)
    if folder.unsealed:
        logger.warning(folder.unsealed)
    published = published or Published()
    description = folder.description()
    evaluation = folder.read_evaluation()
    other = read_mapping(Path(against)) if against is not None else None
    if not path.parent.is_dir():
        raise InputError(f"out '{path}': no such folder {path.parent}", "out")
    if path.is_dir():
        raise InputError(f"out '{path}': a folder, expected a file", "out")
    require_writable(path)
    figures, trained_on = _figures(folder), folder.trained_on()
    solving = _solving(Path(nodal), description) if nodal is not None else None
    units = description.data.units
    beside = {} if other is None else _other_rows(other, str(against), units)
    try:
        page = PAGES.get_template("report.html.j2").render(
            case=description.run.case,
            likelihood=description.run.likelihood.replace("_", " "),
            model=description.run.title,
            recipe=description.run.recipe,
            dimension=description.data.dimension,
            info=description.data.info,
            evaluation=evaluation,
            trained_on=trained_on,
            rows=_joined(_beside(_rows(evaluation, trained_on, units), published), beside),
            published=published,
            other=other,
            figures=figures,
            relative_error=_percent(evaluation["test"].get("relative_error_mean", 0.0)),
            mean_error=description.data.units.written(evaluation["test"]["mean_error"]),
            solving=solving,
            run_configuration=yaml.safe_dump(description.run.plain(), sort_keys=False),
            case_configuration=yaml.safe_dump(description.data.case, sort_keys=False),
        )
    except (LookupError, TypeError, ValueError, UndefinedError) as error:
        reason = f"{type(error).__name__}: {first_line(error)}"
        raise InputError(f"{folder.evaluation}: not measures of a run ({reason})") from None
    write_text(path, page + "\n")


def _figures(run: RunFolder) -> list[Figure]:
    drawn = run.read_figures()
    return [
        Figure(caption, "data:image/png;base64," + b64encode(drawn[name]).decode())
        for name, caption in FIGURES
        if name in drawn
    ]


def _rows(evaluation: dict[str, Any], trained_on: str, units: Units) -> list[tuple[str, str]]:
    unit, factor = _unit(units)
    test, example = evaluation["test"], evaluation["example"]
    minutes = evaluation["training_seconds"] / 60
    return [
        (f"mean error ē [{unit}]", _fixed(test["mean_error"] * factor, 3)),
        *_grid_rows(evaluation.get("embedding_error"), unit, factor),
        (f"standard deviation σ(e) [{unit}]", _fixed(test["std_error"] * factor, 3)),
        ("slope of e_m over displacement", _fixed(test["slope"], 5)),
        (
            "relative tip error, the example below",
            f"{_percent(example['relative_tip_error'])} at "
            f"{_fixed(example['tip_displacement'], 2)} {units.length}",
        ),
        ("trainable parameters", f"{evaluation['trainable_parameters'] / 1e6:.2f} M"),
        ("training time", f"{minutes:.1f} min, {trained_on}"),
        (
            "relative tip error, median of the test split",
            _percent(test["relative_tip_error_median"]),
        ),
        (f"largest error of a component [{unit}]", _fixed(test["max_error"] * factor, 2)),
        ("test samples M", str(test["samples"])),
        *_relative_rows(test),
        *_stress_rows(evaluation.get("von_mises"), units.stress),
        *_uncertainty_rows(evaluation.get("uncertainty"), units),
    ]


def _unit(units: Units) -> tuple[str, float]:
    """Unit of the errors of the table, and the factor to it."""
    return ("10⁻³ m", 1e3) if units.length == "m" else (units.length, 1.0)


def _fixed(value: float, decimals: int) -> str:
    """Write a number with fixed decimals, or three significant digits if those leave but one."""
    small = 0 < abs(value) < 10.0 ** (1 - decimals)
    return f"{value:.3g}" if small else f"{value:.{decimals}f}"


def _percent(share: float) -> str:
    """Write a share in per cent as `_fixed` does."""
    return f"{_fixed(share * 100, 2)}%"


def _beside(rows: list[tuple[str, str]], published: Published) -> list[Row]:
    """Add the published number of every row, or a dash."""
    if not published.numbers:
        return [*rows]
    for name in published.numbers:
        if name not in dict(rows):
            raise InputError(f"published number '{name}': expected one of {', '.join(dict(rows))}")
    return [(name, ours, published.numbers.get(name, "–")) for name, ours in rows]


def _joined(rows: list[Row], other: dict[str, str]) -> list[Row]:
    """Add the other network's number of every row, or a dash."""
    return [(*row, other.get(row[0], "–")) for row in rows] if other else rows


def _other_rows(evaluation: dict[str, Any], path: str, units: Units) -> dict[str, str]:
    """The numbers of another evaluation by the names of their rows."""
    try:
        return dict(_rows(evaluation, evaluation.get("machine", "unknown machine"), units))
    except (LookupError, TypeError, ValueError) as error:
        reason = f"{type(error).__name__}: {first_line(error)}"
        raise InputError(f"{path}: not measures of a run ({reason})") from None


def _relative_rows(test: dict[str, Any]) -> list[tuple[str, str]]:
    """Errors relative to displacements; evaluations of older versions do not have them."""
    names = {
        "relative_error_mean": "mean error of a sample, of its largest displacement",
        "relative_node_error_median": "largest nodal error of a sample, of the same, median",
    }
    return [(text, _percent(test[name])) for name, text in names.items() if name in test]


def _grid_rows(error: float | None, unit: str, factor: float) -> list[tuple[str, str]]:
    """The part of an embedded grid."""
    name = f"part of ē of the embedded grid, without an error at its points [{unit}]"
    return [] if error is None else [(name, _fixed(error * factor, 3))]


def _stress_rows(stress: dict[str, Any] | None, unit: str) -> list[tuple[str, str]]:
    if stress is None:
        return []
    return [
        (
            f"mean error of von Mises stresses [{unit}], of the largest of a sample",
            f"{stress['mean_error']:.3g}, {_percent(stress['relative_error'])}",
        ),
        (
            "error of the largest von Mises stress of a sample, median",
            _percent(stress["relative_error_of_largest_median"]),
        ),
    ]


def _uncertainty_rows(uncertainty: dict[str, Any] | None, units: Units) -> list[tuple[str, str]]:
    if uncertainty is None:
        return []
    unit, factor = _unit(units)
    covered = [
        (
            f"coverage of {interval['level']:.0%} intervals",
            f"{interval['coverage']:.1%}, mean width {units.written(interval['width'])}",
        )
        for interval in uncertainty["intervals"]
    ]
    return [
        *covered,
        ("miscalibration area", f"{uncertainty['miscalibration_area']:.3f}"),
        ("negative log-likelihood [nats]", f"{uncertainty['negative_log_likelihood']:.2f}"),
        (f"continuous ranked probability score [{unit}]", _fixed(uncertainty["crps"] * factor, 4)),
        (
            "rank correlation of error and σ, over nodes / over samples",
            f"{uncertainty['node_rank_correlation']:.2f} / "
            f"{uncertainty['sample_rank_correlation']:.2f}",
        ),
    ]


def _solving(nodal: Path, description: RunDescription) -> Solving:
    reader = DatasetReader(nodal, "nodal")
    manifest = reader.manifest
    if manifest.digest != description.data.info.source_digest:
        raise InputError(f"{nodal}: not the dataset that the run's data was made from")
    seconds = 0.0
    for _, arrays in reader:
        seconds += float(arrays["samples/wall_time"].sum())
    return Solving(manifest.samples, manifest.failed, seconds, manifest.software)
