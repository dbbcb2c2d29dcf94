"""Trainings by the paper's recipe, compiled, with TF32 convolutions and CUDA graphs.

The learning curve says the time to an error. Beside the recipe stand trainings at a constant rate,
without batch norm or with that of the channels. The 3D beam is trained on the samples that are
carried. Its epochs are more than the paper's, because there are fewer samples; the time limit ends
the training.
"""

from __future__ import annotations

from collections.abc import Callable

from experiments.framework.experiment import Findings
from experiments.gpu.setting import GpuSetting
from experiments.gpu.trainings import adapted, train_within
from experiments.measures.untrained import changed, shipped_unet
from surrogate.learning.models import UNetModel
from surrogate.learning.networks import UNetConfig

EPOCHS = 600
WITHOUT = "-without-norm"
OF_KERAS = ("batch_norm_momentum", "batch_norm_epsilon", "initialisation")


def paper_recipe(name: str) -> Callable[[GpuSetting], Findings]:
    """Make the measurement of one of the paper's configurations."""
    return lambda setting: _train(setting, name, shipped_unet(name))


def with_norm(name: str, batch_norm: bool) -> Callable[[GpuSetting], Findings]:
    """Make that with or without a norm of the channels, at a constant rate, as PyTorch begins."""
    network = {
        "batch_norm": batch_norm,
        **{key: UNetConfig.model_fields[key].default for key in OF_KERAS},
    }
    config = shipped_unet(name)
    constant = config.training.schedule.model_copy(update={"name": "constant"})
    config = changed(config, network, {"schedule": constant})
    run = f"{name}-channels" if batch_norm else f"{name}{WITHOUT}"
    return lambda setting: _train(setting, run, config)


def constant_channels(channels: int) -> Callable[[GpuSetting], Findings]:
    """Make that of the paper's 3D network, the same number of channels at every level, no norm."""
    network = {"channels": channels, "multiplier": 1, "batch_norm": False}
    config = changed(shipped_unet("beam3d-det-paper"), network, {})
    return lambda setting: _train(setting, f"beam3d-c{channels}{WITHOUT}", config)


def _train(setting: GpuSetting, name: str, config: UNetModel) -> Findings:
    config = adapted(
        config, setting, precision="tensorfloat32", compile=setting.on_gpu, epochs=EPOCHS
    )
    return train_within(setting, name, config)
