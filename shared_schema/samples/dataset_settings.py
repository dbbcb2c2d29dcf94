"""Settings of a case's dataset: samples, seed, shards and splits."""

from __future__ import annotations

from pydantic import Field, model_validator

from shared_schema.common.configuration import Frozen
from shared_schema.common.units import Count, Seed

MOST_SHARDS = 100_000  # their file names have five digits


class DatasetSettings(Frozen):
    """Number of samples, their seed, and their division into shards and splits.

    Attributes
    ----------
    samples : int
        Number of load cases, training and test together.
    seed : int
        Seed of the random loads; seed and sample number determine a load.
    shard_size : int
        Number of load cases in a shard, the unit in which work is distributed and stored.
    test_fraction : float
        Fraction of the samples that `datagen structure` puts into the test split.
    """

    samples: Count
    seed: Seed = 0
    shard_size: Count = 500
    test_fraction: float = Field(0.05, gt=0, lt=1)

    @model_validator(mode="after")
    def _has_few_shards(self) -> DatasetSettings:
        if self.shards > MOST_SHARDS:
            raise ValueError(
                f"samples = {self.samples} in shards of shard_size = {self.shard_size} are "
                f"{self.shards} shards, expected at most {MOST_SHARDS}"
            )
        return self

    @property
    def shards(self) -> int:
        """Number of shards."""
        return -(-self.samples // self.shard_size)

    def samples_of(self, shard: int) -> range:
        """Sample numbers of a shard."""
        return range(shard * self.shard_size, min((shard + 1) * self.shard_size, self.samples))


def shard_name(shard: int) -> str:
    """File name of a shard."""
    return f"shard-{shard:05d}.h5"
