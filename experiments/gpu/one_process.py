"""Step: `torchrun` with one process trains as a plain call does."""

from __future__ import annotations

import subprocess
import sys

import yaml

from experiments.framework.experiment import Findings
from experiments.framework.machine import ROOT
from experiments.gpu.setting import GpuSetting
from experiments.gpu.trainings import adapted
from experiments.measures.untrained import changed, shipped_unet
from shared_schema.common import WorkError
from surrogate import train
from surrogate.learning.models import UNetModel
from surrogate.learning.runs import RunFolder

CASE = "beam2d"


def one_process(setting: GpuSetting) -> Findings:
    """Train two epochs both ways; return the losses and the time of both."""
    config = changed(adapted(shipped_unet(f"{CASE}-det-fast"), setting), {}, {"epochs": 2})
    plain = RunFolder(setting.out / "runs" / "one-process-1")
    started = RunFolder(setting.out / "runs" / "one-process-2")
    train(config, setting.dataset(CASE), plain.folder, device=setting.device.type)
    failure = by_torchrun(config, setting, started)
    losses = [[line["train_loss"] for line in run.metric_lines()] for run in (plain, started)]
    differences = [abs(a - b) / abs(a) for a, b in zip(*losses, strict=False)]
    if failure:
        raise WorkError(failure)
    return Findings(
        numbers={
            "config": config.plain(),
            "losses": losses[0],
            "losses_by_torchrun": losses[1],
            "largest_relative_difference": max(differences, default=None),
        }
    )


def by_torchrun(config: UNetModel, setting: GpuSetting, run: RunFolder) -> str | None:
    """Train by `torchrun`; return what it says if it fails."""
    path = setting.out / "one-process.yaml"
    path.write_text(yaml.safe_dump(config.plain()))
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=1"]
    command += ["-m", "surrogate.command_line", "train", str(path.absolute())]
    command += ["--data", str(setting.folder_of(CASE).absolute())]
    command += ["--out", str(run.folder.absolute()), "--device", setting.device.type]
    try:
        done = subprocess.run(
            command, cwd=ROOT, capture_output=True, text=True, timeout=setting.seconds_left
        )
    except subprocess.TimeoutExpired:
        return "no end in time"
    return done.stderr[-3000:] if done.returncode else None
