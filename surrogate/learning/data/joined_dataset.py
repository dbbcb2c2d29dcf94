"""A structured dataset as it is read, or several of one case, joined for a training.

The training splits are joined in the order of the datasets, and their statistics are those of all
training samples. The test split is that of the first dataset.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError
from shared_schema.manifest import ComponentStatistics, digest_of
from surrogate.learning.data.body_check import BODY_KEYS, require_same_body
from surrogate.learning.data.dataset import Dataset, joined_parameters, read_single
from surrogate.learning.data.samples import Samples


@checked_arguments
def read_dataset(
    *folders: str | Path, on_disk: bool = False, needs_samples: bool = True
) -> Dataset:
    """Read a structured dataset, or join several of one body and case.

    Of joined datasets, the training splits follow each other, and the test split is that of the
    first one.

    Parameters
    ----------
    *folders : str or Path
        Folders made by ``datagen structure``; one at least.
    on_disk : bool
        Leave the training samples of a single dataset on disk, if it is larger than the memory. A
        configuration with ``training.samples_on`` = ``disk`` needs such a dataset.
    needs_samples : bool
        Refuse a single dataset without samples, as ``datagen body`` makes it.

    Returns
    -------
    Dataset

    Raises
    ------
    InputError
        If there is no dataset, it is of another kind, any byte of it has changed, or the samples
        take more memory than the machine has; if several datasets are of several bodies or cases,
        or are to stay on disk.
    """
    paths = [Path(folder) for folder in folders]
    if len(paths) == 1:
        return read_single(paths[0], on_disk=on_disk, needs_samples=needs_samples)
    if on_disk or not paths:
        on = " with 'training.samples_on' = 'disk'" if on_disk else ""
        raise InputError(f"data: {len(paths)} datasets, expected one{on}", "data")
    datasets = [read_single(path) for path in paths]
    first = datasets[0]
    for path, other in zip(paths[1:], datasets[1:], strict=True):
        require_same_body(
            first.body,
            other.body,
            f"--data '{path}': joined with '{paths[0]}'",
            keys=("name", *BODY_KEYS),
        )
        if other.manifest.forces != first.manifest.forces:
            raise InputError(
                f"data '{path}': joined with '{paths[0]}', expected datasets in which loads act "
                "alike between the nodes; those of earlier versions act at corners",
                "data",
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
        parameters=joined_parameters([one.train.parameters for one in datasets]),
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
    mean = np.array([part.mean for part in parts])
    std = np.array([part.std for part in parts])
    most = np.array([part.max_abs for part in parts])
    share = (counts / counts.sum())[:, None]
    middle = (share * mean).sum(axis=0)
    variance = (share * (std**2 + mean**2)).sum(axis=0) - middle**2
    return ComponentStatistics(
        mean=tuple(middle.tolist()),
        std=tuple(np.sqrt(np.maximum(variance, 0.0)).tolist()),
        max_abs=tuple(most.max(axis=0).tolist()),
    )
