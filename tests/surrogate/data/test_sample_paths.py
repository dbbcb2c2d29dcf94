"""Batches along load paths are base samples moved by t U₁ + t² U₂, mirrored ones as well."""

from __future__ import annotations

import torch

from surrogate.data.dataset import Dataset
from surrogate.data.mirror import with_mirror_images
from surrogate.data.sample_paths import AlongPaths, SamplePaths
from surrogate.data.sample_store import DeviceStore
from surrogate.data.samples import Samples
from surrogate.mechanics.linear_response import LinearResponse
from tests.surrogate.data.test_mirror import symmetric

CPU = torch.device("cpu")


def test_every_sample_moves_along_one_of_its_paths() -> None:
    """ΔF is 1 + k in sample and path k, so that the moved force tells t; U = t + 10 t²."""
    count, paths = 200, 3
    shape = (count, paths, 2, 4, 3)
    rise = torch.arange(1.0, paths + 1).reshape(1, -1, 1, 1, 1).expand(shape)
    base = Samples(*(torch.zeros(count, 2, 4, 3) for _ in range(2)))
    known = SamplePaths(100 * rise, rise, 10 * rise)
    torch.manual_seed(0)
    store = AlongPaths(DeviceStore(base, CPU), known)
    batches = list(store.batches(torch.split(torch.randperm(count), 64)))
    assert [len(batch) for batch in batches] == [64, 64, 64, 8]
    force, u = (torch.cat([getattr(b, n) for b in batches]) for n in ("force", "displacement"))
    assert torch.equal(force, force[:, :1, :1, :1].expand(force.shape))
    found = set()
    for f, value in zip(force[:, 0, 0, 0].tolist(), u[:, 0, 0, 0].tolist(), strict=True):
        fits = [k for k in (1, 2, 3) if abs(k * (t := f / 100 / k) + 10 * k * t**2 - value) < 1e-4]
        assert fits
        found.update(fits)
    assert found == {1, 2, 3}
    assert force.min() < -200
    assert force.max() > 200


def test_paths_of_mirrored_samples(dataset_3d: Dataset) -> None:
    """Of linear elasticity: U₁ = K⁻¹ ΔF holds for the paths of the mirror images too."""
    geometry = symmetric(dataset_3d.geometry)
    response = LinearResponse(geometry, dataset_3d.material, gradient=False)
    change = torch.randn(2, 3, 3, *geometry.grid.shape)
    first = response(change.flatten(0, 1))[0].reshape(change.shape)
    paths = SamplePaths(change, first, 2 * first)
    both = paths.with_mirror_images(geometry, ("y", "z"), "mirrors")
    assert len(both) == 8
    assert torch.equal(both.force[:2], change)
    expected = response(both.force.flatten(0, 1))[0].reshape(both.first.shape)
    torch.testing.assert_close(both.first, expected, rtol=1e-3, atol=1e-5)
    torch.testing.assert_close(both.second, 2 * both.first)
    base = Samples(change[:, 0], first[:, 0])
    images = with_mirror_images(base, geometry, ("y", "z"), "mirrors")
    assert torch.equal(images.force, both.force[:, 0])  # in the order of the samples' images
