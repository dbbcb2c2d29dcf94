"""The steps on a GPU in their order, with the seconds that each may take."""

from experiments.framework.experiment import Experiment
from experiments.gpu.frames import frames
from experiments.gpu.gpu_tests import gpu_tests
from experiments.gpu.latency import latency
from experiments.gpu.recipes import constant_channels, paper_recipe, with_norm
from experiments.gpu.responses import responses
from experiments.gpu.setting import GpuSetting
from experiments.gpu.throughput import throughput

Step = Experiment[GpuSetting]


def _to_the_end(body: str, seconds: float) -> Step:
    name = f"{body}-paper"
    title, work = f"The paper's recipe {name}", paper_recipe(name)
    return Step(f"last-axis-{body}", title, "", work, seconds=seconds)


def _without_norm(body: str, seconds: float) -> Step:
    name = f"{body}-paper"
    title, work = f"{name} without batch norm", with_norm(name, batch_norm=False)
    return Step(f"without-norm-{body}", title, "", work, seconds=seconds)


STEPS: tuple[Step, ...] = (
    Step("gpu-tests", "Tests that are marked gpu", "", gpu_tests, seconds=90),
    Step("latency", "Time of a prediction for 1 to 4096 loads", "", latency, seconds=80),
    Step("throughput", "Samples per second of a training", "", throughput, seconds=90),
    Step("responses", "Networks of the package, for 1 to 4096 loads", "", responses, seconds=50),
    Step("frames", "Frames a second of large bodies", "", frames, seconds=90),
    Step(
        "paper-beam2d-det",
        "beam2d-det-paper with a norm of the channels",
        "",
        with_norm("beam2d-det-paper", batch_norm=True),
        seconds=480,
    ),
    _to_the_end("beam2d-det", 500),
    _to_the_end("beam2d-mle", 500),
    _to_the_end("beam2d-vb", 500),
    _to_the_end("lshape2d-det", 500),
    _to_the_end("lshape2d-mle", 500),
    _to_the_end("lshape2d-vb", 500),
    _without_norm("beam2d-det", 100),
    _without_norm("beam2d-mle", 80),
    _without_norm("beam2d-vb", 80),
    _without_norm("lshape2d-det", 80),
    _without_norm("lshape2d-mle", 80),
    _without_norm("lshape2d-vb", 80),
    Step("beam3d-c64", "The 3D beam with 64 channels", "", constant_channels(64), seconds=60),
)
