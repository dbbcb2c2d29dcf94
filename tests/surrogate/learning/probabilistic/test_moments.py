from __future__ import annotations

from functools import reduce

import numpy as np
import pytest
import torch

from surrogate.learning.probabilistic.distribution import Moments
from surrogate.learning.probabilistic.likelihoods import Prediction


def test_moments_by_hand() -> None:
    """Means 1, 2, 6: their mean is 3, their variance (4 + 1 + 9) / 2 = 7.

    Deviations 1, 2, 2: mean square (1 + 4 + 4) / 3 = 3. Total: √(7 + 3).
    """
    means, stds = torch.tensor([1.0, 2.0, 6.0]), torch.tensor([1.0, 2.0, 2.0])
    moments = Moments.of(Prediction(means.reshape(3, 1, 1, 1), stds.reshape(3, 1, 1, 1)))
    assert moments.mean.item() == 3
    assert moments.std_epistemic.item() == pytest.approx(np.sqrt(7))
    assert moments.std_aleatoric.item() == pytest.approx(np.sqrt(3))
    assert moments.std.item() == pytest.approx(np.sqrt(10))


@pytest.mark.parametrize("cuts", [(1,), (4,), (1, 2, 3), (2, 5)], ids=str)
def test_parts_joined_are_the_whole(cuts: tuple[int, ...]) -> None:
    """Against NumPy, around a mean of 1e6 deviations: sums of squares would cancel."""
    rng = np.random.default_rng(0)
    means, stds = 1e6 + rng.normal(size=(7, 2, 3, 2)), rng.random((7, 2, 3, 2))
    parts = zip(*(np.split(values, cuts) for values in (means, stds)), strict=True)
    moments = reduce(
        Moments.joined,
        (Moments.of(Prediction(torch.from_numpy(m), torch.from_numpy(s))) for m, s in parts),
    )
    assert moments.passes == 7
    np.testing.assert_allclose(moments.mean, means.mean(axis=0), rtol=1e-15)
    np.testing.assert_allclose(moments.std_epistemic, means.std(axis=0, ddof=1), rtol=1e-9)
    rms = np.sqrt((stds**2).mean(axis=0))
    np.testing.assert_allclose(moments.std_aleatoric, rms, rtol=1e-12)


def test_one_pass_has_no_spread() -> None:
    moments = Moments.of(Prediction(torch.ones(1, 1, 2, 2), None))
    assert torch.equal(moments.mean, torch.ones(1, 2, 2))
    assert not moments.std.any()
