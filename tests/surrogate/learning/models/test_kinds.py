"""Kinds of model: each accepts only the keys that it reads."""

from __future__ import annotations

from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, Literal

import pytest
from torch import Tensor, nn

from shared_schema.common.errors import InputError
from surrogate.learning.models import kinds
from surrogate.learning.models.kinds import add_model, run_config
from surrogate.learning.models.model import Deterministic
from surrogate.learning.models.network_model import NetworkModel
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.config_reader import read_config
from tests.surrogate.unet_configs import shipped_unet

BASELINES = ("linear", "pod", "gp", "dropout", "ensemble")
MLE = "likelihood: maximum_likelihood"
BAYES = "likelihood: variational_bayes\nvariational: {}"
VALIDATION = "validation_fraction: 0.1"


def test_defaults_are_one_plain_unet() -> None:
    config = run_config({"name": "a", "case": "b"})
    assert isinstance(config, UNetModel)
    assert (config.model, config.likelihood) == ("unet", "deterministic")
    assert config.ensemble == 1
    assert config.network.dropout == 0.0


@pytest.mark.parametrize("model", BASELINES)
def test_cases_differ_by_their_name_alone(model: str) -> None:
    beam, l_shape = (read_config(f"{case}-{model}-fast") for case in ("beam2d", "lshape2d"))
    renamed = beam.model_copy(update={"name": l_shape.name, "case": "lshape2d"})
    assert renamed == l_shape


@pytest.mark.parametrize(
    "model", ["det", "mle", "vb", "ensemble", "gp", "modal-gp", "reduced", "reduced-vb"]
)
def test_cases_of_any_load_differ_by_their_name_alone(model: str) -> None:
    """Beam and L-shape; in space, mirrors differ, and the samples kept for bounds."""
    beam, l_shape = (read_config(f"{case}_any-{model}-fast") for case in ("beam2d", "lshape2d"))
    renamed = beam.model_copy(update={"name": l_shape.name, "case": "lshape2d_any"})
    assert renamed == l_shape
    if model.startswith("reduced"):
        for case in ("beam3d_any", "finger3d"):
            other = read_config(f"{case}-{model}-fast").plain()
            expected = beam.plain()
            for config in (other, expected):
                for key in ("mirrors", "calibration_fraction"):
                    del config["training"][key]
            assert other | {"name": beam.name, "case": beam.case} == expected


@pytest.mark.parametrize(("kind", "epochs"), [("mle", 60), ("vb", 20)])
def test_mechanics_are_added_to_the_networks_of_single_loads(kind: str, epochs: int) -> None:
    """Inputs, series, errors, epochs, and how factors are fitted differ from beam2d's."""
    plain, mechanics = (shipped_unet(f"{case}-{kind}-fast") for case in ("beam2d", "beam2d_any"))
    inputs = ("force", "linear_gradient", "last_gradient")
    added = {"inputs": inputs, "skip": "series", "series_order": 4}
    assert mechanics.network == plain.network.model_copy(update=added)
    changed = {"errors": "laplace", "validation_fraction": 0.1, "recalibrate": 0.95}
    assert mechanics.training == plain.training.model_copy(update=changed | {"epochs": epochs})


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (
            "model: tree",
            "model 'tree': unknown, expected one of linear, pod, reduced, series, unet",
        ),
        ("model: pod", "key 'pod' is missing (model pod, likelihood deterministic)"),
        ("pod: {}", "unknown key 'pod' (model unet, likelihood deterministic)"),
        ("model: linear\nensemble: 3", "unknown key 'ensemble' (model linear"),
        ("ensemble: 0", "key 'ensemble' = 0"),
        (
            "model: pod\npod: {regression: gp}",
            "key 'pod.regression' = 'gp': input should be 'ridge' (model pod, likelihood determin",
        ),
    ],
)
def test_what_does_not_fit_is_named(tmp_path: Path, text: str, part: str) -> None:
    assert_refused(tmp_path, text, part)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        *(
            (
                f"model: pod\npod: {{}}\ntraining: {{{VALIDATION}, {key}: {value}}}",
                f"unknown key 'training.{key}' (model pod, likelihood deterministic)",
            )
            for key, value in {
                "ema": "0.9",
                "early_stopping": "{patience: 3}",
                "compile": "true",
                "recalibrate": "true",
                "epochs": "3",
                "loss": "mae",
            }.items()
        ),
        ("training: {beta: 0.5}", "unknown key 'training.beta' (model unet, likelihood determin"),
        (
            f"training: {{{VALIDATION}, recalibrate: true}}",
            "'training.recalibrate' = True: expected a model that predicts standard deviations",
        ),
        (
            "model: linear\ntraining: {optimiser: {name: muon}}",
            "'training.optimiser.name' = 'muon': expected 'adam' of model 'linear'",
        ),
        (
            "training: {optimiser: {name: adam, momentum: 0.5}}",
            "key 'training.optimiser': momentum = 0.5: expected with name 'muon' only",
        ),
        (
            "training: {optimiser: {rho_factor: 2}}",
            "'training.optimiser.rho_factor' = 2.0: expected 1, as no standard deviation",
        ),
        (
            "training: {schedule: {name: constant, final: 0.1}}",
            "key 'training.schedule': final = 0.1: expected none with name 'constant'",
        ),
        (
            "network: {force_transforms: [linear, asinh]}",
            "'network.force_transforms' = ['linear', 'asinh']: expected 1 at most, the number of",
        ),
        (
            f"model: pod\n{MLE}\npod: {{regression: gp, degree: 2}}",
            "unknown key 'pod.degree' (model pod, likelihood maximum_likelihood)",
        ),
        (
            f"model: pod\n{MLE}\npod: {{regression: gp, input_modes: 9}}",
            "key 'pod': input_modes = 9: expected with inputs 'linear_modes' only",
        ),
        (
            "model: pod\npod: {rank: 3, energy: 0.9}",
            "key 'pod': energy = 0.9: expected none beside rank = 3",
        ),
    ],
)
def test_keys_without_effect_are_refused(tmp_path: Path, text: str, part: str) -> None:
    assert_refused(tmp_path, text, part)


def assert_refused(folder: Path, text: str, part: str) -> None:
    """Require an error of one line that names the file and the wrong key."""
    path = folder / "a.yaml"
    path.write_text(f"name: a\ncase: b\n{text}")
    with pytest.raises(InputError) as error:
        read_config(str(path))
    assert str(error.value).startswith(f"{path}: ")
    assert part in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("change", [{"ensemble": 2}, {"network": {"dropout": 0.1}}])
def test_recalibration_of_deterministic_networks_that_differ(change: dict[str, object]) -> None:
    """Ensembles and networks with dropout predict standard deviations without a likelihood."""
    training = {"validation_fraction": 0.1, "recalibrate": True}
    config = run_config({"name": "a", "case": "b", "training": training, **change})
    assert config.training.validation_users == ("recalibrate",)


class Line(NetworkModel):
    """An architecture of somebody else's."""

    title, likelihoods = "line", (Deterministic,)
    model: Literal["line"]
    width: int = 3

    def make_network(self, dimension: int, free: Tensor, shape: Tensor | None = None) -> nn.Module:
        return self.members(free, shape)

    def member(self, free: Tensor, number: int, parameters: int = 0) -> nn.Module:
        return nn.Identity()

    @property
    def architecture(self) -> str:
        return "line"


def test_an_installed_package_adds_an_architecture(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [
        EntryPoint("line", f"{__name__}:Line", kinds.GROUP),
        EntryPoint("bent", f"{__name__}:Line", kinds.GROUP),
        EntryPoint("gone", "no_such_module:Line", kinds.GROUP),
    ]
    monkeypatch.setattr(kinds, "entry_points", lambda group: points)
    found = run_config({"name": "a", "case": "b", "model": "line", "width": 5})
    assert isinstance(found, Line)
    assert found.plain()["width"] == 5
    for name, said in (("bent", "Literal\\['bent'\\]"), ("gone", "cannot be imported")):
        with pytest.raises(InputError, match=said):
            run_config({"name": "a", "case": "b", "model": name})
    for name, kind in (("unet", Line), ("line", Line)):
        with pytest.raises(InputError, match="there is one already"):
            add_model(name, kind)
    nothing: Any = nn.Identity
    with pytest.raises(InputError, match=r"a subclass of surrogate\.NetworkModel"):
        add_model("other", nothing)
