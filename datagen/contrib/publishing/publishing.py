"""Make a benchmark of a nodal dataset: what others are given, and the answers that are kept.

The test split is that of `datagen structure`. Its displacements are in ``answers.npz`` alone: they
are taken out of the arrays before anything that others are given is written.
"""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from datagen.contrib.plaid import exporting
from datagen.contrib.publishing import score
from datagen.contrib.publishing.card import card
from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError
from shared_schema.common.files import sha256, write_text

HERE = Path(__file__).parent
MESH = ("coordinates", "cells", "clamped", "loadable")
ANSWERS, SPLITS = "answers.npz", "splits.json"
STREAM = 3  # keeps the random numbers of the validation split apart from the others of a dataset


@checked_arguments
def publish(
    nodal: Path | str,
    out: Path | str,
    *,
    license: str,
    owner: str = "unknown",
    python: Path | str | None = None,
    validation: float = 0.05,
    baselines: Mapping[str, Path | str] | None = None,
) -> dict[str, int]:
    """Write a dataset for others, whose test split has inputs only, and the answers beside it.

    ``huggingface/`` has a card (``README.md``), a file of Parquet for each split, the mesh,
    ``splits.json`` and ``score.py``; ``plaid/`` has the same samples in PLAID's format;
    ``answers.npz`` is to be kept.

    Parameters
    ----------
    nodal : Path or str
        Nodal dataset, also one of a family of shapes.
    out : Path or str
        New folder; it appears complete, or not at all.
    license, owner : str
        Of the dataset, for its card; the licence as the Hugging Face Hub names it.
    python : Path or str, optional
        Interpreter of an environment with pyplaid; by default this one.
    validation : float
        Part of all samples that is the validation split, drawn from the others by the seed.
    baselines : mapping of str to Path or str, optional
        Predictions for the hidden test, as `score.py` reads them, by the name of what made them;
        their scores are in the card.

    Returns
    -------
    dict of str to int
        Number of samples of each split.

    Raises
    ------
    InputError
        As `datagen.export_plaid`; or if no samples are left for training, or predictions are wrong.
    WorkError
        If pyplaid fails.
    """
    folder, out = Path(nodal), Path(out)
    exporting.require_new(out)
    interpreter = exporting.require_interpreter(python)
    reader = exporting.carried(folder)
    splits = with_validation(exporting.splits_of(reader.manifest), validation, reader.manifest.seed)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=".partial-") as scratch:
        arrays, made = Path(scratch, "arrays"), Path(scratch, out.name)
        exporting.write_arrays(reader, arrays)
        answers, given = made / ANSWERS, made / "huggingface"
        given.mkdir(parents=True)
        numbers = np.load(arrays / "number.npy")
        hide(arrays, numbers, splits["test"], answers)
        try:
            scores = {k: score.scores(Path(v), answers) for k, v in (baselines or {}).items()}
        except ValueError as error:
            raise InputError(f"--baseline {error}") from None
        about = {"backend": "hf_datasets", "owner": owner, "license": license}
        exporting.write_about(reader, arrays, splits, **about)
        exporting.run_script(interpreter, exporting.SCRIPT, arrays, made / "plaid")
        exporting.run_script(interpreter, HERE / "write_parquet.py", arrays, given / "data")
        mesh = {name: reader.body[f"mesh/{name}"] for name in MESH}
        np.savez(given / "mesh.npz", **mesh)  # type: ignore[arg-type]
        shutil.copy(HERE / "score.py", given)
        told = {"seed": reader.manifest.seed, **{k: numbers[v].tolist() for k, v in splits.items()}}
        write_text(given / SPLITS, json.dumps(told) + "\n")
        counts = {name: len(rows) for name, rows in splits.items()}
        text = card(reader, counts, sha256(answers), scores, license, owner)
        write_text(given / "README.md", text)
        write_text(given / "baselines.json", json.dumps(scores, indent=1) + "\n")
        made.rename(out)
    return counts


def with_validation(splits: exporting.Splits, part: float, seed: int) -> exporting.Splits:
    """Split off round(part · N) training samples by the seed.

    Raises
    ------
    InputError
        If none are left.
    """
    train, test = splits["train"], splits["test"]
    count = round(part * (len(train) + len(test))) if 0 < part < 1 else 0
    if not 0 < count < len(train):
        raise InputError(
            f"--validation {part:g}: {count} of {len(train)} samples, expected a part below 1 that "
            "leaves some in both splits"
        )
    order = np.random.default_rng([seed, STREAM]).permutation(len(train))
    rest, chosen = np.sort(order[count:]), np.sort(order[:count])
    return {"train": train[rest], "validation": train[chosen], "test": test}


def hide(arrays: Path, numbers: np.ndarray, rows: np.ndarray, answers: Path) -> None:
    """Move the displacements of some rows to a file of answers, and leave NaN in their place."""
    displacement = np.load(arrays / "displacement.npy", mmap_mode="r+")
    np.savez(answers, number=numbers[rows], displacement=displacement[rows])
    displacement[rows] = np.nan
    displacement.flush()
