from __future__ import annotations

import pickletools
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

import surrogate
from shared_schema.common.errors import InputError
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.training.loop import train

pytestmark = pytest.mark.filterwarnings("ignore::surrogate.OutsideTrainingWarning")


@pytest.fixture(scope="module")
def model(trained: Path) -> surrogate.Surrogate:
    return surrogate.load(trained)


@pytest.fixture
def copy(trained: Path, tmp_path: Path) -> RunFolder:
    shutil.copytree(trained, tmp_path / "run")
    return RunFolder(tmp_path / "run")


def test_prediction_is_that_of_the_network_on_the_grid(
    model: surrogate.Surrogate, dataset: Dataset
) -> None:
    """The mesh is in grid order: node ix · 4 + iy is at grid point (ix, iy)."""
    force = dataset.test.force
    with torch.no_grad():
        expected = model.network(force).mean.double().numpy()
    nodal = force.double().numpy().reshape(12, 2, 32).swapaxes(1, 2)
    found = model.predict(nodal)
    expected = expected.reshape(12, 2, 32).swapaxes(1, 2)
    np.testing.assert_array_equal(model.averaged_passes(nodal).mean, expected)
    rounding = 3e-6 * np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=rounding)
    assert np.abs(found).max() > 1e-2
    np.testing.assert_allclose(model.predict(nodal[3]), found[3], rtol=0, atol=rounding)  # alone


def test_prediction_in_3d(
    tmp_path: Path, dataset_3d: Dataset, make_config: Callable[..., UNetModel]
) -> None:
    run = RunFolder(tmp_path / "run")
    train(make_config(dimension=3, epochs=1), dataset_3d, run.folder, device="cpu")
    model = surrogate.load(run.folder)
    predicted = model.predict(np.ones((2, 128, 3)) * ~model.geometry.clamped[:, None])
    assert predicted.shape == (2, 128, 3)
    assert not predicted[:, model.geometry.clamped].any()


@pytest.mark.parametrize("shape", [(32,), (31, 2), (32, 3), (2, 32), (1, 1, 32, 2), (0,)], ids=str)
def test_wrong_shape(model: surrogate.Surrogate, shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"expected \(32, 2\)"):
        model.predict(np.zeros(shape))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_force_that_is_not_finite(model: surrogate.Surrogate, value: float) -> None:
    forces = np.zeros((2, 32, 2))
    forces[1, 31, 0] = value
    with pytest.raises(InputError, match="NaN or an infinity"):
        model.predict(forces)


def test_no_samples(model: surrogate.Surrogate) -> None:
    assert model.predict(np.zeros((0, 32, 2))).shape == (0, 32, 2)


@pytest.mark.parametrize("name", ["lshape2d_any", "beam3d_any", "beam3d_any_reduced", "finger3d"])
def test_no_loads_on_shipped_networks(name: str) -> None:
    """Series, reduced networks and networks on embedded grids."""
    none = np.zeros((0, *surrogate.load(name).geometry.coordinates.shape))
    assert surrogate.load(name).predict(none).shape == none.shape


@pytest.fixture(scope="module")
def likely(make_run: Callable[..., Path]) -> surrogate.Surrogate:
    return surrogate.load(make_run(epochs=2, likelihood="maximum_likelihood"))


@pytest.fixture(scope="module")
def bayes(make_run: Callable[..., Path]) -> surrogate.Surrogate:
    variational = {"biases": True, "initial_std": 0.1}
    run = make_run(epochs=2, likelihood="variational_bayes", variational=variational)
    return surrogate.load(run)


FORCES = np.random.default_rng(0).normal(size=(3, 32, 2))
FORCES[:, :4] = 0  # clamped nodes


def assert_equal(one: Distribution, other: Distribution) -> None:
    for name, field in one.fields().items():
        np.testing.assert_array_equal(field, other.fields()[name], err_msg=name)


def test_deterministic_network_has_no_spread_and_one_pass(model: surrogate.Surrogate) -> None:
    assert not model.is_probabilistic
    assert not model.is_stochastic
    with pytest.raises(InputError, match=r"predicts no standard deviations, expected Surrogate\.p"):
        model.predict_distribution(FORCES)
    found = model.averaged_passes(FORCES, passes=7, seed=1)
    assert not found.std.any()
    assert_equal(found, model.averaged_passes(FORCES))
    largest = np.abs(found.mean).max()
    np.testing.assert_allclose(model.predict(FORCES), found.mean, rtol=0, atol=3e-6 * largest)


def test_maximum_likelihood_has_aleatoric_spread_only(
    likely: surrogate.Surrogate, dataset: Dataset
) -> None:
    """The aleatoric σ is the network's; passes do not differ, so the epistemic σ is exactly 0."""
    assert likely.is_probabilistic
    assert not likely.is_stochastic
    found = likely.predict_distribution(FORCES, passes=7, seed=1)
    assert not found.std_epistemic.any()
    np.testing.assert_array_equal(found.std, found.std_aleatoric)
    free = ~likely.geometry.clamped
    assert (found.std_aleatoric[:, free] > 0).all()
    assert not found.std_aleatoric[:, ~free].any()
    assert_equal(found, likely.predict_distribution(FORCES))
    force = dataset.test.force
    with torch.no_grad():
        std = likely.network(force).std
    assert std is not None
    nodal = force.double().numpy().reshape(12, 2, 32).swapaxes(1, 2)
    expected = std.double().numpy().reshape(12, 2, 32).swapaxes(1, 2)
    np.testing.assert_allclose(likely.predict_distribution(nodal).std, expected, rtol=1e-6)


def test_variational_network_has_both_spreads(bayes: surrogate.Surrogate) -> None:
    assert bayes.is_probabilistic
    assert bayes.is_stochastic
    found = bayes.predict_distribution(FORCES, passes=20)
    free = ~bayes.geometry.clamped
    for field in (found.std_epistemic, found.std_aleatoric):
        assert (field[:, free] > 0).all()
        assert not field[:, ~free].any()
    np.testing.assert_allclose(
        found.std**2, found.std_epistemic**2 + found.std_aleatoric**2, rtol=1e-12
    )
    assert set(found.fields()) == {"displacement", "std", "std_epistemic", "std_aleatoric"}


def test_passes_are_those_of_their_seed(bayes: surrogate.Surrogate) -> None:
    found = bayes.predict_distribution(FORCES, passes=5, seed=3)
    other = bayes.predict_distribution(FORCES, passes=5, seed=4)
    assert_equal(bayes.predict_distribution(FORCES, passes=5, seed=3), found)
    free = ~bayes.geometry.clamped
    assert (found.mean[:, free] != other.mean[:, free]).mean() > 0.99
    # one sample and several samples use the same passes
    alone = bayes.predict_distribution(FORCES[1], passes=5, seed=3)
    np.testing.assert_allclose(alone.mean, found.mean[1], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(alone.std_epistemic, found.std_epistemic[1], rtol=1e-3, atol=1e-6)


def test_prediction_is_the_mean_of_300_passes(bayes: surrogate.Surrogate) -> None:
    """The default is the paper's, Section 3; 20 samples take 2 batches of 4096."""
    forces = np.random.default_rng(1).normal(size=(20, 32, 2)) * ~bayes.geometry.clamped[:, None]
    expected = bayes.predict_distribution(forces, passes=300, seed=0).mean
    np.testing.assert_array_equal(bayes.predict(forces), expected)


@pytest.mark.parametrize("passes", [0, -1])
def test_wrong_number_of_passes(bayes: surrogate.Surrogate, passes: int) -> None:
    with pytest.raises(InputError, match=f"passes = {passes}, expected 1 at least"):
        bayes.predict_distribution(FORCES, passes=passes)


@pytest.mark.parametrize("kept", [0, 4, 100, -1])
def test_truncated_model(copy: RunFolder, kept: int) -> None:
    copy.model.write_bytes(copy.model.read_bytes()[:kept])
    with pytest.raises(InputError, match=r"model\.safetensors"):
        surrogate.load(copy.folder)


@pytest.mark.parametrize(
    "name", ["network.head.bias", "geometry.grid/node_at", "geometry.clamped", "force_scale"]
)
def test_model_that_lacks_a_tensor(copy: RunFolder, name: str) -> None:
    tensors = load_file(copy.model)
    del tensors[name]
    copy.write_tensors(tensors)
    with pytest.raises(InputError, match=r"model\.safetensors: does not fit config\.yaml"):
        surrogate.load(copy.folder)


def test_nothing_in_a_run_is_pickled(evaluated: Path) -> None:
    files = [path for path in evaluated.rglob("*") if path.is_file()]
    suffixes = {path.suffix for path in files}
    assert suffixes == {".yaml", ".safetensors", ".jsonl", ".json", ".png", ".txt"}
    for path in files:
        content = path.read_bytes()
        assert not zipfile.is_zipfile(path), path
        assert not content.startswith(b"\x80"), path
        if path.suffix == ".safetensors":
            # the file begins with eight bytes of length and a JSON header, which unpickling rejects
            assert content[8:9] == b"{", path
            with pytest.raises(ValueError):  # noqa: PT011, which byte it stumbles at is chance
                list(pickletools.genops(content))


@pytest.mark.parametrize("shape", [(32, 2), (3, 32, 2)], ids=str)
def test_force_at_a_clamped_node_is_refused(
    model: surrogate.Surrogate, shape: tuple[int, ...]
) -> None:
    """As the command does; nodes 0 to 3 are clamped."""
    forces = np.zeros(shape)
    forces[..., 2, 1] = 1e-3
    with pytest.raises(InputError, match="forces at node 2: the node is clamped, expected a free"):
        model.predict(forces)


@pytest.mark.parametrize("name", ["network.head.bias", "force_scale", "geometry.coordinates"])
def test_weights_that_are_not_finite_are_refused(copy: RunFolder, name: str) -> None:
    tensors = copy.read_tensors()
    tensors[name].view(-1)[0] = torch.nan
    copy.write_tensors(tensors)
    with pytest.raises(InputError, match=f"safetensors: '{name}' holds a NaN"):
        surrogate.load(copy.folder)


def test_certify_and_correct(model: surrogate.Surrogate) -> None:
    """A corrected prediction is certified; one Newton step lowers the error of another."""
    forces = np.zeros((32, 2))
    forces[31] = 0.1, -0.2
    correction = model.correct(forces)
    assert correction.residual_norm <= 1e-8
    assert model.certify(forces, correction.displacement).max_error < 1e-9
    found = model.certify(np.stack([forces, forces]))
    assert found.error.shape == (2, 32, 2)
    one = model.predict(forces) - found.error[0]
    assert np.abs(one - correction.displacement).max() < found.max_error[0]


def test_certificates_refuse_wrong_input(model: surrogate.Surrogate, copy: RunFolder) -> None:
    with pytest.raises(InputError, match=r"predicted has shape \(31, 2\), expected \(32, 2\)"):
        model.certify(np.zeros((32, 2)), np.zeros((31, 2)))
    with pytest.raises(InputError, match=r"forces have shape \(3, 32, 2\), expected \(32, 2\)"):
        model.correct(FORCES)
    text = copy.config.read_text()
    copy.config.write_text(text.replace("    material:", "    substance:"))
    copy.seal.add([copy.config])
    with pytest.raises(InputError, match="material of the run's case: expected a mapping"):
        surrogate.load(copy.folder).certify(FORCES)
