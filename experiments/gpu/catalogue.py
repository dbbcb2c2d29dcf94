"""The steps on a GPU in their order, with the seconds that each may take."""

from experiments.framework.experiment import Experiment
from experiments.gpu.frames import frames
from experiments.gpu.gpu_tests import gpu_tests
from experiments.gpu.latency import latency
from experiments.gpu.one_process import one_process
from experiments.gpu.recipes import (
    constant_channels,
    fast_recipe,
    paper_recipe,
    reduced_recipe,
)
from experiments.gpu.responses import responses
from experiments.gpu.setting import GpuSetting
from experiments.gpu.step_profile import step_profile
from experiments.gpu.throughput import throughput

Step = Experiment[GpuSetting]
LIVER = "liver3d-reduced-fast", 3  # linear responses to body forces


def _fast(body: str, seconds: float) -> Step:
    name = f"{body}-fast"
    return Step(f"fast-{body}", f"Our recipe {name}", "", fast_recipe(name), seconds=seconds)


def _paper(body: str, seconds: float) -> Step:
    name = f"{body}-paper"
    return Step(
        f"paper-{body}", f"The paper's recipe {name}", "", paper_recipe(name), seconds=seconds
    )


def _without_norm(body: str, seconds: float) -> Step:
    name = f"{body}-paper"
    title, work = f"{name} without batch norm", paper_recipe(name, batch_norm=False)
    return Step(f"without-norm-{body}", title, "", work, seconds=seconds)


STEPS: tuple[Step, ...] = (
    Step("gpu-tests", "Tests that are marked gpu", "", gpu_tests, seconds=90),
    Step("latency", "Time of a prediction for 1 to 4096 loads", "", latency, seconds=80),
    Step("throughput", "Samples per second of a training", "", throughput, seconds=90),
    Step("profile", "Where the time of a training step goes", "", step_profile, seconds=40),
    Step("responses", "Networks of the package, for 1 to 4096 loads", "", responses, seconds=50),
    Step("frames", "Frames a second of large bodies", "", frames, seconds=90),
    Step("liver3d", "A reduced network of an organ", "", reduced_recipe(*LIVER), seconds=40),
    _fast("beam2d-det", 50),
    _fast("lshape2d-det", 40),
    _paper("beam2d-det", 480),
    _without_norm("beam2d-det", 100),
    _without_norm("beam2d-mle", 80),
    _without_norm("beam2d-vb", 80),
    _without_norm("lshape2d-det", 80),
    _without_norm("lshape2d-mle", 80),
    _without_norm("lshape2d-vb", 80),
    Step("beam3d-c64", "The 3D beam with 64 channels", "", constant_channels(64), seconds=60),
    Step("one-process", "torchrun with one process", "", one_process, seconds=60),
)
