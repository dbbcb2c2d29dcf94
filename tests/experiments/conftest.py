"""Made-up datasets and trained runs are those of the learner's tests."""

from tests.surrogate.conftest import (
    _one_thread,
    data,
    data_3d,
    dataset,
    dataset_3d,
    evaluated,
    make_config,
    make_dataset,
    make_run,
    trained,
)

__all__ = [
    "_one_thread",
    "data",
    "data_3d",
    "dataset",
    "dataset_3d",
    "evaluated",
    "make_config",
    "make_dataset",
    "make_run",
    "trained",
]
