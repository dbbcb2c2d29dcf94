"""The steps on a GPU in their order, with the seconds that each may take."""

from experiments.framework.experiment import Experiment
from experiments.gpu.gpu_tests import gpu_tests
from experiments.gpu.latency import latency
from experiments.gpu.one_process import one_process
from experiments.gpu.recipes import constant_channels, fast_recipe, paper_recipe
from experiments.gpu.setting import GpuSetting
from experiments.gpu.step_profile import step_profile
from experiments.gpu.throughput import throughput

Step = Experiment[GpuSetting]


def _fast(body: str, seconds: float) -> Step:
    name = f"{body}-fast"
    return Step(f"fast-{body}", f"Our recipe {name}", "", fast_recipe(name), seconds=seconds)


def _paper(body: str, seconds: float) -> Step:
    name = f"{body}-paper"
    return Step(
        f"paper-{body}", f"The paper's recipe {name}", "", paper_recipe(name), seconds=seconds
    )


STEPS: tuple[Step, ...] = (
    Step("gpu-tests", "Tests that are marked gpu", "", gpu_tests, seconds=120),
    Step("latency", "Time of a prediction for 1 to 4096 loads", "", latency, seconds=100),
    Step("throughput", "Samples per second of a training", "", throughput, seconds=100),
    Step("profile", "Where the time of a training step goes", "", step_profile, seconds=40),
    _fast("beam2d-det", 50),
    _fast("lshape2d-det", 40),
    _paper("beam2d-det", 480),
    _paper("lshape2d-det", 270),
    _paper("beam2d-mle", 40),
    _paper("beam2d-vb", 80),
    Step("beam3d-c64", "The 3D beam with 64 channels", "", constant_channels(64), seconds=60),
    _paper("beam3d-det", 80),
    Step("one-process", "torchrun with one process", "", one_process, seconds=60),
    _paper("lshape2d-mle", 40),
    _paper("lshape2d-vb", 80),
)
