"""Trainings by the paper's recipe, compiled, with TF32 convolutions and CUDA graphs.

The learning curve says the time to an error. Without batch norm, everything else of the recipe is
as it is. The 3D beam is trained on the samples that are carried. Its epochs are more than the
paper's, because there are fewer samples; the time limit ends the training.
"""

from __future__ import annotations

from collections.abc import Callable

from experiments.framework.experiment import Findings
from experiments.gpu.setting import GpuSetting
from experiments.gpu.trainings import adapted, train_within
from experiments.measures.untrained import changed, shipped_unet
from surrogate.learning.models import UNetModel

EPOCHS = 600
WITHOUT = "-without-norm"


def paper_recipe(name: str, batch_norm: bool = True) -> Callable[[GpuSetting], Findings]:
    """Make the measurement of one of the paper's configurations."""
    config = changed(shipped_unet(name), {"batch_norm": batch_norm}, {})
    run = name if batch_norm else f"{name}{WITHOUT}"
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
