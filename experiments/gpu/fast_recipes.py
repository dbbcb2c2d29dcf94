"""Steps: our recipes for two CPU cores on the GPU; the learning curve says the time to an error."""

from __future__ import annotations

from collections.abc import Callable

from experiments.gpu.setting import Results, Setting
from experiments.gpu.trainings import adapted, train_within
from tests.surrogate.unet_configs import shipped_unet


def fast_recipe(name: str) -> Callable[[Setting], Results]:
    """Make the step of a shipped configuration; convolutions stay in float32."""

    def work(setting: Setting) -> Results:
        return train_within(setting, name, adapted(shipped_unet(name), setting))

    return work
