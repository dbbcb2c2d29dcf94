"""The report of one run: a self-contained HTML page with figures and the paper's numbers."""

from __future__ import annotations

import base64
import html
from pathlib import Path
from typing import Any

import yaml

from shared_schema.common.atomic_file import write_text
from shared_schema.common.errors import InputError
from shared_schema.dataset_reader import DatasetReader
from surrogate.evaluation.published import PUBLISHED
from surrogate.runs.description import RunDescription
from surrogate.runs.folder import RunFolder

Row = tuple[str, str, str]

FIGURES = (
    (
        "deformed.png",
        "A test load at the free end: the deformed mesh that the U-Net predicts (blue) over that "
        "of the finite elements (red), and the undeformed mesh (grey, dashed).",
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

MODELS = {"unet": "U-Net", "linear": "linear layer", "pod": "POD regression"}

STYLE = """
body { font: 16px/1.5 Georgia, 'Times New Roman', serif; max-width: 46rem; margin: 2rem auto;
  padding: 0 1rem; color: #222; }
h1 { font-size: 1.6rem; line-height: 1.2; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
table { border-collapse: collapse; margin: 1rem 0; } th, td { text-align: left;
  padding: .3rem 1.2rem .3rem 0; border-bottom: 1px solid #ddd; }
th { border-bottom: 1px solid #222; } thead { border-top: 1px solid #222; }
figure { margin: 1.6rem 0; } img { max-width: 100%; display: block; margin: 0 auto; }
figcaption { font-size: .9rem; color: #555; margin-top: .4rem; }
pre { background: #f6f6f6; padding: .8rem; overflow-x: auto; font-size: .8rem; line-height: 1.35; }
"""


def write_report(run_folder: Path, nodal: Path | None, path: Path) -> None:
    """Write the report of an evaluated run.

    Parameters
    ----------
    run_folder : Path
        The run, evaluated.
    nodal : Path, optional
        The nodal dataset that its data came from, for the time that the equilibria took.
    path : Path
        The HTML file to write.

    Raises
    ------
    InputError
        If the run is not evaluated, or the nodal dataset is another's.
    """
    run = RunFolder(run_folder)
    description = run.description()
    evaluation = run.read_evaluation()
    if not path.parent.is_dir():
        raise InputError(f"--out '{path}': no such folder {path.parent}")
    solving = _solving(nodal, description) if nodal is not None else None
    write_text(path, _page(run, description, evaluation, solving))


def _page(
    run: RunFolder, description: RunDescription, evaluation: dict[str, Any], solving: str | None
) -> str:
    case = html.escape(description.run.case)
    info = description.data.info
    test = evaluation["test"]
    grid = " × ".join(str(n) for n in info.grid_shape)
    kind = description.run.likelihood.replace("_", " ")
    summary = (
        f"A {kind} {MODELS[description.run.model]} of {evaluation['trainable_parameters']:,} "
        f"parameters, trained on {info.train} finite-element solutions of case <b>{case}</b> in "
        f"{evaluation['training_seconds'] / 60:.1f} minutes, predicts the {info.test} "
        f"test solutions with a mean error ē = {test['mean_error'] * 1e3:.3f} mm."
    )
    figures = "\n".join(
        f'<figure><img alt="{html.escape(caption)}" src="{_embed(run.figures / name)}">'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
        for name, caption in FIGURES
        if (run.figures / name).is_file()
    )
    made = [
        f"Grid {grid}, d = {description.data.dimension}; {info.train} training and {info.test} "
        f"test samples (split seed {info.split_seed}).",
        f"Training: {evaluation['epochs']} epochs, {evaluation['training_seconds']:.0f} s on "
        f"{evaluation['machine']}, torch {evaluation['torch']}, seed {evaluation['seed']}, recipe "
        f"“{description.run.recipe}”.",
        f"Dataset digest <code>{evaluation['data_digest'][:16]}</code>.",
    ]
    if solving:
        made.insert(0, solving)
    items = "".join(f"<li>{line}</li>" for line in made)
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Surrogate of {case}</title>
<style>{STYLE}</style></head><body>
<h1>Surrogate of case {case}</h1>
<p>{summary}</p>
<h2>Errors on the test split</h2>
{_table(_rows(description, evaluation))}
<p>Paper: Deshpande, Lengiewicz, Bordas, <i>Probabilistic deep learning for real-time large
deformation simulations</i>, CMAME 2022. e<sub>m</sub> is the mean absolute error over the
components of one sample; ē and σ(e) are its mean and standard deviation over the test split.</p>
<h2>Figures</h2>
{figures}
<h2>How it was made</h2>
<ul>{items}</ul>
<pre>{html.escape(yaml.safe_dump(description.run.plain(), sort_keys=False))}</pre>
<pre>{html.escape(yaml.safe_dump(description.data.case, sort_keys=False))}</pre>
</body></html>
"""


def _rows(description: RunDescription, evaluation: dict[str, Any]) -> list[Row]:
    test, example = evaluation["test"], evaluation["example"]
    paper = PUBLISHED.get((description.run.case, description.run.likelihood))
    minutes = evaluation["training_seconds"] / 60
    rows = [
        ("mean error ē [10⁻³ m]", f"{test['mean_error'] * 1e3:.3f}"),
        ("standard deviation σ(e) [10⁻³ m]", f"{test['std_error'] * 1e3:.3f}"),
        ("slope of e_m over displacement", f"{test['slope']:.5f}"),
        (
            "relative tip error, the example below",
            f"{example['relative_tip_error']:.2%} at {example['tip_displacement']:.2f} m",
        ),
        ("trainable parameters", f"{evaluation['trainable_parameters'] / 1e6:.2f} M"),
        ("training time", f"{minutes:.1f} min, {evaluation['machine']}"),
        (
            "relative tip error, median of the test split",
            f"{test['relative_tip_error_median']:.2%}",
        ),
        ("largest error of a component [10⁻³ m]", f"{test['max_error'] * 1e3:.2f}"),
        ("test samples M", str(test["samples"])),
        *_uncertainty_rows(evaluation.get("uncertainty")),
    ]
    theirs = (
        [
            f"{paper.mean_error * 1e3:.1f}",
            f"{paper.std_error * 1e3:.1f}",
            f"{paper.slope}",
            "–"
            if paper.relative_tip_error is None
            else f"{paper.relative_tip_error:.1%} at {paper.tip_displacement} m",
            f"{paper.parameters / 1e6:.1f} M",
            f"{paper.training_minutes:.0f} min, one V100",
        ]
        if paper
        else []
    )
    return [
        (name, ours, theirs[i] if i < len(theirs) else "–") for i, (name, ours) in enumerate(rows)
    ]


def _uncertainty_rows(uncertainty: dict[str, Any] | None) -> list[tuple[str, str]]:
    if uncertainty is None:
        return []
    covered = [
        (
            f"coverage of {interval['level']:.0%} intervals",
            f"{interval['coverage']:.1%}, mean width {interval['width'] * 1e3:.2f} mm",
        )
        for interval in uncertainty["intervals"]
    ]
    return [
        *covered,
        ("miscalibration area", f"{uncertainty['miscalibration_area']:.3f}"),
        ("negative log-likelihood [nats]", f"{uncertainty['negative_log_likelihood']:.2f}"),
        ("continuous ranked probability score [10⁻³ m]", f"{uncertainty['crps'] * 1e3:.4f}"),
        (
            "rank correlation of error and σ, over nodes / over samples",
            f"{uncertainty['node_rank_correlation']:.2f} / "
            f"{uncertainty['sample_rank_correlation']:.2f}",
        ),
    ]


def _table(rows: list[Row]) -> str:
    body = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    head = "<tr><th></th><th>here</th><th>paper</th></tr>"
    return f"<table><thead>{head}</thead><tbody>{body}</tbody></table>"


def _solving(nodal: Path, description: RunDescription) -> str:
    reader = DatasetReader(nodal, "nodal")
    manifest = reader.manifest
    if manifest.digest != description.data.info.source_digest:
        raise InputError(f"{nodal}: not the dataset that the run's data was made from")
    wall = 0.0
    for _, arrays in reader:
        wall += float(arrays["samples/wall_time"].sum())
    return (
        f"Equilibria: {manifest.samples} solved, {manifest.failed} failed, {wall:.1f} core seconds "
        f"({1e3 * wall / max(manifest.samples, 1):.2f} ms each); dolfinx "
        f"{manifest.software['dolfinx']}, PETSc {manifest.software['petsc']}."
    )


def _embed(path: Path) -> str:
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode()
