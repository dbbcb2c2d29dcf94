"""Configurations of U-Nets, with the type that says so."""

from __future__ import annotations

from typing import Any

from surrogate.learning.models.kinds import run_config
from surrogate.learning.models.unet_model import UNetModel
from surrogate.learning.runs.config_reader import read_config


def unet_config(**content: Any) -> UNetModel:
    """A configuration of U-Nets by its keys."""
    config = run_config({"name": "a", "case": "b", **content})
    assert isinstance(config, UNetModel)
    return config


def shipped_unet(name: str) -> UNetModel:
    """A shipped configuration of U-Nets."""
    config = read_config(name)
    assert isinstance(config, UNetModel)
    return config
