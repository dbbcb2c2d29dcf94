"""What a configuration of a run says, in a few words."""

from __future__ import annotations

from surrogate.runs.configuration import RunConfig

ERRORS = {"mse": "squared error", "mae": "absolute error"}


def network_in_words(config: RunConfig) -> str:
    """Architecture, such as "4 U-Nets, 3 levels, c = 16, doubling, SiLU"."""
    if config.model != "unet":
        return {"linear": "linear layer", "pod": "orthogonal modes"}[config.model]
    network = config.network
    count = f"{config.ensemble} U-Nets" if config.ensemble > 1 else "U-Net"
    growth = {1: "constant", 2: "doubling"}.get(network.multiplier, f"×{network.multiplier}")
    activation = {"relu": "ReLU", "silu": "SiLU"}.get(network.activation, network.activation)
    norm = ", batch norm" if network.batch_norm else ""
    return f"{count}, {network.levels} levels, c = {network.channels}, {growth}, {activation}{norm}"


def training_in_words(config: RunConfig) -> str:
    """Loss and optimiser, such as "absolute error, Muon, 80 epochs, batches of 32"."""
    training, loss = config.training, config.likelihood.replace("_", " ").replace("bayes", "Bayes")
    if config.likelihood == "deterministic":
        loss = ERRORS[training.loss]
    optimiser = training.optimiser.name.capitalize()
    return f"{loss}, {optimiser}, {training.epochs} epochs, batches of {training.batch_size}"
