"""Steps: the paper's networks and training, with TF32 convolutions and CUDA graphs.

The 3D beam is trained on the samples that are carried. Its epochs are more than the paper's,
because there are fewer samples; the time limit ends the training.
"""

from __future__ import annotations

from collections.abc import Callable

from experiments.gpu.setting import Results, Setting
from experiments.gpu.trainings import adapted, changed, train_within
from surrogate.models.unet_model import UNetModel
from tests.surrogate.unet_configs import shipped_unet

EPOCHS = 600


def paper_recipe(name: str) -> Callable[[Setting], Results]:
    """Make the step of a shipped configuration."""
    return lambda setting: _train(setting, name, shipped_unet(name))


def constant_channels(channels: int) -> Callable[[Setting], Results]:
    """Make the step of the paper's 3D network with the same number of channels at every level."""

    def work(setting: Setting) -> Results:
        network = {"channels": channels, "multiplier": 1}
        config = changed(shipped_unet("beam3d-det-paper"), network, {})
        return _train(setting, f"beam3d-c{channels}", config)

    return work


def _train(setting: Setting, name: str, config: UNetModel) -> Results:
    config = adapted(config, setting, precision="tensorfloat32", epochs=EPOCHS)
    return train_within(setting, name, config)
