"""Training of one network within a time, and its errors on the test split."""

from __future__ import annotations

import shutil
from typing import Any

import torch

from experiments.framework.experiment import Findings
from experiments.gpu.setting import GpuSetting
from experiments.measures.untrained import changed
from surrogate import Dataset, Evaluation, evaluate, train
from surrogate.learning.models import UNetModel
from surrogate.learning.runs import RunFolder, load_tensors

RESERVE = {"variational_bayes": 22.0}  # s for the evaluation; 10 of other likelihoods
CURVE = 200  # lines of the learning curve in the result
PASSES = 300


def adapted(config: UNetModel, setting: GpuSetting, **training: Any) -> UNetModel:
    """Return a configuration for the device: with CUDA graphs on a GPU, and small if asked."""
    training |= {"cuda_graphs": setting.on_gpu}
    if setting.small:
        return changed(config, {"channels": 4}, {**training, "epochs": 2})
    return changed(config, {}, training)


def train_within(setting: GpuSetting, name: str, config: UNetModel) -> Findings:
    """Train for the time of the setting, resuming what an earlier call has begun, and evaluate."""
    dataset = setting.dataset(config.case)
    run = RunFolder(setting.out / "runs" / name)
    if setting.on_gpu:
        torch.cuda.reset_peak_memory_stats(setting.device)
    reserve = RESERVE.get(config.likelihood, 10.0)
    train(
        config,
        dataset,
        run.folder,
        device=setting.device.type,
        seconds=max(1e-3, setting.seconds_left - reserve),
    )
    memory = torch.cuda.max_memory_allocated(setting.device) if setting.on_gpu else None
    finished = run.model.is_file()
    evaluation = evaluated(run if finished else as_it_is(run, dataset), setting, config.case)
    lines = run.metric_lines()
    numbers: dict[str, Any] = {
        "config": config.plain(),
        "seed": config.seed,
        "train_samples": len(dataset.train),
        "test_samples": len(dataset.test),
        "data_digest": dataset.manifest.digest,
        "epochs": lines[-1]["epoch"],
        "training_seconds": lines[-1]["seconds"],
        "peak_memory_bytes": memory,
        "test": evaluation.measures.plain(),
        "curve": lines[:: max(1, len(lines) // CURVE)],
    }
    if evaluation.calibration is not None:
        numbers["uncertainty"] = evaluation.calibration.plain()
    return Findings(numbers=numbers, finished=finished)


def evaluated(run: RunFolder, setting: GpuSetting, case: str) -> Evaluation:
    """Evaluate a run on the test split."""
    passes = 5 if setting.small else PASSES
    data, device = setting.folder_of(case), setting.device.type
    return evaluate(run.folder, data, device=device, passes=passes)


def as_it_is(run: RunFolder, dataset: Dataset) -> RunFolder:
    """Make a finished run beside an unfinished one, from its last checkpoint."""
    partial = RunFolder(run.folder.with_name(f"{run.folder.name}-unfinished"))
    shutil.rmtree(partial.folder, ignore_errors=True)
    partial.folder.mkdir()
    for path in (run.config, run.metrics):
        shutil.copy(path, partial.folder)
    tensors, _ = load_tensors(run.checkpoint)
    prefix = "network."
    weights = {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
    partial.write_tensors({**weights, **dataset.geometry.tensors()})
    return partial
