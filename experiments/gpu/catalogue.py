"""The steps on a GPU in their order, with the seconds that each may take."""

from experiments.framework.experiment import Experiment
from experiments.gpu.frames import frames
from experiments.gpu.gpu_tests import gpu_tests
from experiments.gpu.latency import latency
from experiments.gpu.recipes import constant_channels, paper_recipe
from experiments.gpu.responses import responses
from experiments.gpu.setting import GpuSetting
from experiments.gpu.throughput import throughput

Step = Experiment[GpuSetting]


def _without_norm(body: str, seconds: float) -> Step:
    name = f"{body}-paper"
    title, work = f"{name} without batch norm", paper_recipe(name, batch_norm=False)
    return Step(f"without-norm-{body}", title, "", work, seconds=seconds)


STEPS: tuple[Step, ...] = (
    Step("gpu-tests", "Tests that are marked gpu", "", gpu_tests, seconds=90),
    Step("latency", "Time of a prediction for 1 to 4096 loads", "", latency, seconds=80),
    Step("throughput", "Samples per second of a training", "", throughput, seconds=90),
    Step("responses", "Networks of the package, for 1 to 4096 loads", "", responses, seconds=50),
    Step("frames", "Frames a second of large bodies", "", frames, seconds=90),
    Step(
        "paper-beam2d-det",
        "The paper's recipe beam2d-det-paper",
        "",
        paper_recipe("beam2d-det-paper"),
        seconds=480,
    ),
    _without_norm("beam2d-det", 100),
    _without_norm("beam2d-mle", 80),
    _without_norm("beam2d-vb", 80),
    _without_norm("lshape2d-det", 80),
    _without_norm("lshape2d-mle", 80),
    _without_norm("lshape2d-vb", 80),
    Step("beam3d-c64", "The 3D beam with 64 channels", "", constant_channels(64), seconds=60),
)
