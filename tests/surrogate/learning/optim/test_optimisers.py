from __future__ import annotations

import pytest
import torch
from pydantic import ValidationError

from surrogate.learning.networks.unet import UNet, UNetConfig
from surrogate.learning.optim.optimisers import (
    Muon,
    OptimiserConfig,
    ScheduleConfig,
    make_optimisers,
    set_learning_rate,
)
from surrogate.learning.probabilistic.flipout import VariationalConvolutions

# There are 100 steps, the first 20 of them a warm-up with the factor (step + 1) / 20. After it, the
# remaining fraction is left = (1 - step / 100) / 0.8, at most 1: 0.5 at step 60, 0.0125 at step 99.
# Cosine is (1 - cos(π · left)) / 2: 0.5 at step 60, sin²(π · 0.0125 / 2) = 3.8552e-4 at step 99.


@pytest.mark.parametrize(
    ("name", "final", "expected"),
    [
        ("constant", 0.0, {0: 0.05, 9: 0.5, 18: 0.95, 19: 1.0, 20: 1.0, 60: 1.0, 99: 1.0}),
        ("linear", 0.0, {0: 0.05, 9: 0.5, 18: 0.95, 19: 1.0, 20: 1.0, 60: 0.5, 99: 0.0125}),
        ("linear", 0.2, {0: 0.05, 20: 1.0, 60: 0.6, 99: 0.21}),
        ("cosine", 0.0, {0: 0.05, 19: 1.0, 20: 1.0, 60: 0.5, 99: 3.8552e-4}),
        ("cosine", 0.2, {20: 1.0, 60: 0.6, 99: 0.2 + 0.8 * 3.8552e-4}),
    ],
)
def test_schedule_by_hand(name: str, final: float, expected: dict[int, float]) -> None:
    schedule = ScheduleConfig.model_validate({"name": name, "warmup": 0.2, "final": final})
    found = {step: schedule.factor(step, 100) for step in expected}
    assert found == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("name", ["constant", "linear", "cosine"])
def test_schedule_without_warm_up_starts_at_the_peak(name: str) -> None:
    schedule = ScheduleConfig.model_validate({"name": name})
    assert schedule.factor(0, 10) == 1.0
    assert all(0.0 < schedule.factor(step, 10) <= 1.0 for step in range(10))


def names_of(optimiser: torch.optim.Optimizer, network: torch.nn.Module) -> set[str]:
    name_of = {id(p): name for name, p in network.named_parameters()}
    return {name_of[id(p)] for group in optimiser.param_groups for p in group["params"]}


def test_muon_takes_the_kernels_between_hidden_layers() -> None:
    network = UNet(2, 2, UNetConfig(levels=2, channels=8))
    muon, adam = make_optimisers(network, OptimiserConfig(name="muon", weight_decay=0.1))
    assert isinstance(muon, Muon)
    assert isinstance(adam, torch.optim.AdamW)
    # the convolutions of a level are its layers 0 and 3; the first one of the network has 2 inputs
    assert names_of(muon, network) == {
        "encoder.0.3.weight",
        "encoder.1.0.weight",
        "encoder.1.3.weight",
        "decoder.0.0.weight",
        "decoder.0.3.weight",
    }
    every = {name for name, _ in network.named_parameters()}
    assert names_of(adam, network) == every - names_of(muon, network)
    assert muon.param_groups[0]["weight_decay"] == 0.1


@pytest.mark.parametrize("prior_mean", ["trainable", "zero"])
def test_muon_takes_the_means_of_probabilistic_kernels_only(prior_mean: str) -> None:
    """Muon never updates ρ and prior means, which also have the shape of kernels, or biases."""
    config = VariationalConvolutions.model_validate(
        {"convolutions": [1, 2], "biases": True, "prior_mean": prior_mean}
    )
    network = UNet(2, 4, UNetConfig(levels=2, channels=8), config)
    muon, adam, spread = make_optimisers(network, OptimiserConfig(name="muon"))
    assert names_of(muon, network) == {
        "encoder.0.3.kernel.mean",
        "encoder.1.0.kernel.mean",
        "encoder.1.3.kernel.mean",
        "decoder.0.0.kernel.mean",
        "decoder.0.3.kernel.mean",
    }
    every = {name for name, _ in network.named_parameters()}
    assert names_of(spread, network) == {name for name in every if name.endswith("rho")}
    assert names_of(adam, network) == every - names_of(muon, network) - names_of(spread, network)
    assert ("encoder.1.0.kernel.prior_mean" in every) == (prior_mean == "trainable")


def test_muon_takes_weights_and_means_side_by_side() -> None:
    network = UNet(3, 6, UNetConfig(levels=2, channels=8), VariationalConvolutions(levels=(1,)))
    muon, *_ = make_optimisers(network, OptimiserConfig(name="muon"))
    assert names_of(muon, network) == {
        "encoder.0.3.weight",
        "encoder.1.0.weight",
        "encoder.1.3.kernel.mean",
        "decoder.0.0.weight",
        "decoder.0.3.weight",
    }


def test_rho_has_a_learning_rate_of_its_own_and_no_weight_decay() -> None:
    """Weight decay would pull σ = ln(1 + e^ρ) towards ln 2."""
    network = UNet(2, 4, UNetConfig(levels=2, channels=8), VariationalConvolutions())
    config = OptimiserConfig(name="adam", weight_decay=0.1, rho_factor=10)
    rest, spread = make_optimisers(network, config)
    set_learning_rate([rest, spread], 2e-3)
    assert rest.param_groups[0]["lr"] == 2e-3
    assert spread.param_groups[0]["lr"] == pytest.approx(2e-2)
    assert [o.param_groups[0]["weight_decay"] for o in (rest, spread)] == [0.1, 0.0]


@pytest.mark.parametrize(
    "wrong", [{"name": "sgd"}, {"learning_rate": 0}, {"momentum": 1}, {"gradient_clip": 0}]
)
def test_wrong_values(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        OptimiserConfig.model_validate(wrong)


@pytest.mark.parametrize("capturable", [False, True])
@pytest.mark.parametrize(
    ("bias", "frozen", "kinds"),
    [
        (True, (), [Muon, torch.optim.AdamW]),
        (False, (), [Muon]),
        (True, ("0.weight",), [torch.optim.AdamW]),
        (True, ("0.bias",), [Muon]),
        (True, ("0.weight", "0.bias"), []),
    ],
)
def test_networks_without_some_kind_of_parameter(
    capturable: bool, bias: bool, frozen: tuple[str, ...], kinds: list[type]
) -> None:
    """A network has an optimiser for each kind of parameter in it, and none for an absent kind."""
    network = torch.nn.Sequential(torch.nn.Conv2d(8, 8, 3, bias=bias))
    for name in frozen:
        network.get_parameter(name).requires_grad_(False)
    optimisers = make_optimisers(network, OptimiserConfig(name="muon"), capturable)
    assert [type(optimiser) for optimiser in optimisers] == kinds
    trained = [p for o in optimisers for group in o.param_groups for p in group["params"]]
    assert len(trained) == sum(p.requires_grad for p in network.parameters())
    set_learning_rate(optimisers, 0.1)
    assert all(float(g["lr"]) == pytest.approx(0.1) for o in optimisers for g in o.param_groups)


def one_cycle_of_torch(steps: int, warmup: float, final: float) -> list[float]:
    """Return the rates of OneCycleLR with a peak of 1; they start at 1/25 and end at `final`."""
    optimiser = torch.optim.SGD([torch.zeros(1)], lr=1.0)
    scheduler = torch.optim.lr_scheduler.OneCycleLR(
        optimiser,
        max_lr=1.0,
        total_steps=steps,
        pct_start=warmup,
        div_factor=25.0,
        final_div_factor=1 / (25 * final) if final else float("inf"),
        cycle_momentum=False,
    )
    rates = []
    for _ in range(steps):
        rates.append(optimiser.param_groups[0]["lr"])
        optimiser.step()
        scheduler.step()
    return rates


@pytest.mark.parametrize("steps", [10, 97, 1000])
@pytest.mark.parametrize("warmup", [0.3, 0.25, 0.5])
@pytest.mark.parametrize("final", [0.0, 1e-3, 0.2])
@pytest.mark.filterwarnings("ignore:.*step")
def test_one_cycle_is_that_of_torch(steps: int, warmup: float, final: float) -> None:
    schedule = ScheduleConfig(name="one_cycle", warmup=warmup, final=final)
    rates = [schedule.factor(step, steps) for step in range(steps)]
    assert rates == pytest.approx(one_cycle_of_torch(steps, warmup, final), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("warmup", [0.0, 0.1, 0.9])
@pytest.mark.parametrize("steps", [1, 2, 10])
def test_one_cycle_of_few_steps(steps: int, warmup: float) -> None:
    schedule = ScheduleConfig(name="one_cycle", warmup=warmup, final=0.1)
    assert all(1 / 25 <= schedule.factor(step, steps) <= 1 for step in range(steps))


def test_one_cycle_without_warm_up_starts_at_the_peak() -> None:
    assert ScheduleConfig(name="one_cycle").factor(0, 100) == 1.0
