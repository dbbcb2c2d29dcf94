r"""Step: where the time of a training step goes, and what limits it.

The time of a step is at least that of its floating-point operations and that of the bytes that it
has to move through the device's memory, at rates that are measured on the same device:

.. math:: t ≥ \max\left(\frac{\text{FLOP}}{\text{FLOP/s}},
   \frac{\text{bytes}}{\text{bytes/s}}\right)

The bytes are those of Adam's step (weight, gradient and two moments read; weight, two moments
and gradient written), of the weights read in forward and backward pass, and of every layer's
output, written once and read twice. What remains is launches, copies and small kernels.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn
from torch.profiler import ProfilerActivity, profile
from torch.utils.flop_counter import FlopCounterMode

from experiments.benchmarks.training import configuration
from experiments.framework.experiment import Findings
from experiments.framework.timing import Timing, median_seconds
from experiments.gpu.setting import GpuSetting, Results
from experiments.gpu.throughput import NETWORKS, small_or_whole
from surrogate import Dataset
from surrogate.learning.data import Samples
from surrogate.learning.models import UNetModel
from surrogate.learning.networks import parameter_count
from surrogate.learning.training import Trainer
from surrogate.runtime.device import Precision, lay_out

BATCH = 4
STEPS = 20
TOP = 15  # kernels in the result
WEIGHT_ACCESSES = 8 + 2 + 1  # Adam's; forward and backward pass; gradient written
OUTPUT_ACCESSES = 3


def step_profile(setting: GpuSetting) -> Findings:
    """Profile steps of all networks, eager and as graphs."""
    result: Results = {
        "ceilings": measured_ceilings(setting),
        "steps": [],
    }
    for name in NETWORKS:
        for precision in ("tensorfloat32", "bfloat16"):
            for graphs in (False, True):
                if setting.seconds_left < 5:
                    return Findings(numbers={**result, "complete": False})
                described = {"network": name, "precision": precision, "graphs": graphs}
                measured = of_network(setting, name, precision, graphs)
                least = least_times(measured, precision, result["ceilings"])
                result["steps"].append({**described, **measured, "least_ms": least})
    return Findings(numbers={**result, "complete": True})


def measured_ceilings(setting: GpuSetting) -> Results:
    """Rates of a large copy, bytes read and written per s, and of large matrix products, FLOP/s."""
    size = 2**20 if setting.small else 2**29
    source = torch.rand(size, device=setting.device)
    target = torch.empty_like(source)
    copying = median(setting, lambda: target.copy_(source))
    side = 128 if setting.small else 8192
    rates = {}
    for name, dtype in {"float32": torch.float32, "bfloat16": torch.bfloat16}.items():
        a = torch.randn(side, side, device=setting.device, dtype=dtype)
        b = torch.randn(side, side, device=setting.device, dtype=dtype)
        rates[name] = 2 * side**3 / median(setting, partial(torch.mm, a, b))
    before = torch.backends.cuda.matmul.allow_tf32
    torch.backends.cuda.matmul.allow_tf32 = True
    a = torch.randn(side, side, device=setting.device)
    b = torch.randn(side, side, device=setting.device)
    rates["tensorfloat32"] = 2 * side**3 / median(setting, partial(torch.mm, a, b))
    torch.backends.cuda.matmul.allow_tf32 = before
    return {"bytes_per_second": 2 * source.nbytes / copying, "flop_per_second": rates}


def least_times(step: Results, precision: Precision, ceilings: Results) -> Results:
    """Times in ms that the FLOP and the bytes of a step take at the measured rates."""
    return {
        "flop": 1e3 * step["flop"] / ceilings["flop_per_second"][precision],
        "bytes": 1e3 * step["bytes"] / ceilings["bytes_per_second"],
    }


def median(setting: GpuSetting, work: Callable[[], object]) -> float:
    """Median time of some work in s, up to the end of its last kernel."""

    def whole() -> None:
        work()
        setting.wait()

    return median_seconds(whole, Timing(repeats=1 if setting.small else 5, seconds=1.0))


def of_network(setting: GpuSetting, name: str, precision: Precision, graphs: bool) -> Results:
    """Profile the steps of one network."""
    recipe, case, shape = NETWORKS[name]
    changes = {"precision": precision, "cuda_graphs": graphs, "batch_size": BATCH}
    config = small_or_whole(setting, configuration(recipe, case, changes), shape)
    dataset = setting.dataset(case)
    trainer = make_trainer(setting, config, dataset)
    batch = dataset.train[:BATCH].to(setting.device)
    step: Callable[[Samples], Tensor] = trainer.captured_step or partial(trainer.step, whole=BATCH)
    for _ in range(6):
        step(batch)
    setting.wait()
    activities = [ProfilerActivity.CPU] + [ProfilerActivity.CUDA] * setting.on_gpu
    steps = 2 if setting.small else STEPS
    seconds = median(setting, lambda: [step(batch) for _ in range(steps)]) / steps
    with profile(activities=activities) as recorded:
        for _ in range(steps):
            step(batch)
        setting.wait()
    least = least_work(trainer, batch)
    return {"step_ms": 1e3 * seconds, **least, **by_kind(recorded, steps)}


def make_trainer(setting: GpuSetting, config: UNetModel, dataset: Dataset) -> Trainer:
    """Make a trainer on the device."""
    network = config.build(dataset.geometry, dataset.info)
    lay_out(network, dataset.geometry.dimension, config.training.precision, setting.device)
    network.train()
    return Trainer(config, network, dataset.train[: 4 * BATCH], dataset.train[:0])


def least_work(trainer: Trainer, batch: Samples) -> Results:
    """FLOP of forward and backward pass, and the bytes of a step."""
    outputs = Counter[str]()

    def record(_: nn.Module, __: Any, output: object) -> None:
        if isinstance(output, Tensor):
            outputs["bytes"] += output.nbytes

    leaves = [m for m in trainer.network.modules() if not list(m.children())]
    hooks = [module.register_forward_hook(record) for module in leaves]
    with FlopCounterMode(display=False) as counted:
        trainer.differentiate(batch, len(batch))
    for hook in hooks:
        hook.remove()
    weights = 4 * parameter_count(trainer.network)
    moved = WEIGHT_ACCESSES * weights + OUTPUT_ACCESSES * outputs["bytes"]
    return {"flop": counted.get_total_flops(), "bytes": moved}


def by_kind(recorded: profile, steps: int) -> Results:
    """Times in ms and counts for a step: kernels, copies and launches; and the longest kernels."""
    times, counts, kernels = Counter[str](), Counter[str](), Counter[str]()
    for event in recorded.events() or ():  # type: ignore[no-untyped-call]
        if event.is_user_annotation:  # spans kernels that are events themselves
            continue
        if event.device_type.name == "CUDA":
            kind = "copies" if event.name.startswith(("Memcpy", "Memset")) else "kernels"
            times[kind] += event.time_range.elapsed_us()
            kernels[event.name[:120]] += event.time_range.elapsed_us()
        elif "Launch" in event.name and event.name.startswith("cu"):
            kind = f"launches by {event.name}"
            times[kind] += event.time_range.elapsed_us()
        else:
            continue
        counts[kind] += 1
    return {
        "times_ms": {kind: time / 1e3 / steps for kind, time in times.items()},
        "counts": {kind: count / steps for kind, count in counts.items()},
        "longest_kernels_ms": {k: t / 1e3 / steps for k, t in kernels.most_common(TOP)},
    }
