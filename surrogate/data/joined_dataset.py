"""Several structured datasets of one case, joined for a training.

The training splits are joined in the order of the datasets, and their statistics are those of all
training samples. The test split is that of the first dataset.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from shared_schema.common.errors import InputError
from shared_schema.manifest import ComponentStatistics, digest_of
from surrogate.data.body_check import BODY_KEYS, Body, require_same_body
from surrogate.data.dataset import Dataset, read_dataset
from surrogate.data.samples import Samples


def read_datasets(folders: Sequence[Path], on_disk: bool = False) -> Dataset:
    """Read a structured dataset, or join several.

    Parameters
    ----------
    folders : sequence of Path
    on_disk : bool
        Leave the training samples of a single dataset on disk.

    Raises
    ------
    InputError
        As `read_dataset`, or if the datasets are of several bodies or cases, or several are to stay
        on disk.
    """
    if len(folders) == 1:
        return read_dataset(folders[0], on_disk)
    if on_disk:
        raise InputError(
            f"--data: {len(folders)} datasets, expected one with 'training.samples_on' = 'disk'"
        )
    datasets = [read_dataset(folder) for folder in folders]
    first = datasets[0]
    for folder, other in zip(folders[1:], datasets[1:], strict=True):
        require_same_body(
            Body(first.manifest.case, first.geometry.arrays()),
            Body(other.manifest.case, other.geometry.arrays()),
            f"--data '{folder}': joined with '{folders[0]}'",
            keys=("name", *BODY_KEYS),
        )
    return joined(datasets)


def joined(datasets: Sequence[Dataset]) -> Dataset:
    """Join datasets of one body, whose training samples are in memory."""
    first, counts = datasets[0], np.array([len(one.train) for one in datasets])
    info = first.info.model_copy(
        update={
            "train": int(counts.sum()),
            "force": pooled([one.info.force for one in datasets], counts),
            "displacement": pooled([one.info.displacement for one in datasets], counts),
        }
    )
    manifest = first.manifest.model_copy(
        update={
            "structured": info,
            "samples": info.train + info.test,
            "digest": digest_of({"joined": [one.manifest.digest for one in datasets]}),
        }
    )
    train = Samples(
        torch.cat([one.train.force for one in datasets]),
        torch.cat([one.train.displacement for one in datasets]),
    )
    return replace(
        first,
        manifest=manifest,
        train_in_memory=train,
        further_on_disk=tuple(one.train_on_disk for one in datasets[1:]),
    )


def pooled(
    parts: Sequence[ComponentStatistics], counts: np.ndarray[tuple[int], np.dtype[np.int64]]
) -> ComponentStatistics:
    r"""Statistics of all samples together, from those of parts of :math:`n_k` samples.

    .. math:: m = \sum_k n_k m_k / n, \qquad s^2 + m^2 = \sum_k n_k (s_k^2 + m_k^2) / n
    """
    mean, std, most = (
        np.array([getattr(part, name) for part in parts]) for name in ("mean", "std", "max_abs")
    )
    share = (counts / counts.sum())[:, None]
    middle = (share * mean).sum(axis=0)
    variance = (share * (std**2 + mean**2)).sum(axis=0) - middle**2
    return ComponentStatistics(
        mean=tuple(middle.tolist()),
        std=tuple(np.sqrt(np.maximum(variance, 0.0)).tolist()),
        max_abs=tuple(most.max(axis=0).tolist()),
    )
