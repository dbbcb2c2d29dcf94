r"""Training without solutions: by the potential energy of random load cases.

In equilibrium the potential energy :math:`Π(u) = E(u) - f · u` is lowest
(`surrogate.mechanics.equilibrium.out_of_balance`). A network u(f; θ) is trained by its mean over
random load cases, each over the work of its linear response:

.. math::
    L(θ) = \frac{1}{N} \sum_f \frac{Π(u(f; θ))}{f · K(0)^{-1} f}, \qquad
    \frac{∂L}{∂θ} = \frac{1}{N} \sum_f \frac{r \cdot ∂u/∂θ}{f · K(0)^{-1} f}

with the forces r = ∂Π/∂u that are out of balance. Of a linear body the least value is -1/2. Load
cases with an inverted cell, where Π is infinite, are left out. No solution of the finite elements
is needed.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.files import require_writable
from shared_schema.common.progress import Progress
from surrogate.learning.data.case_loads import Loads
from surrogate.learning.inference.fresh_loads import loads_of
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.models.model import TrainedModel
from surrogate.learning.optim.optimisers import make_optimisers, set_learning_rate
from surrogate.learning.runs.description import Origin, Refinement, RunDescription
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.metric_lines import write_lines
from surrogate.learning.training.trainer import all_finite
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.runtime.device import choose_device
from surrogate.runtime.hardware import hardware
from surrogate.runtime.seeds import REFINEMENT, stream
from surrogate.runtime.tensor_file import tensor_digest

Array = NDArray[np.float64]
EPOCH = 100  # steps between two lines of measures


@checked_arguments
def refine(
    run: str | Path,
    out: str | Path,
    *,
    steps: int,
    family: str = "trained",
    learning_rate: float = 3e-5,
    seed: int = 0,
    device: str = "auto",
) -> Surrogate:
    """Train a network on by the potential energy of random loads, without solutions.

    Parameters
    ----------
    run : str or Path
        Run folder, or the name of a network that comes with the package.
    out : str or Path
        New run folder; of a run that is refined like this already, it is read.
    steps : int
        Number of training steps.
    family : str
        Random loads, such as ``loads=1-8,reach=2,places=free``; by default those of the training.
    learning_rate : float
        That of the first step; it falls linearly to zero.
    seed : int
        Seed of the random loads.
    device : {"auto", "cpu", "cuda"}

    Returns
    -------
    Surrogate
        The refined network, as `surrogate.load` returns it.

    Raises
    ------
    InputError
        If the network predicts standard deviations or is fitted directly, its run does not name its
        material, or the folder belongs to another run.
    WorkError
        If the training diverges; nothing is written then.
    """
    given = {"family": family, "steps": steps, "learning_rate": learning_rate, "seed": seed}
    refinement = validate(Refinement, given, "options")
    target, folder = choose_device(device), RunFolder(Path(out))
    require_writable(folder.folder)
    surrogate = load(run, target.type)
    config = surrogate.description.run
    if not isinstance(config, TrainedModel) or surrogate.is_probabilistic:
        raise InputError(
            f"{run}: config '{config.name}', expected a deterministic network that was trained"
        )
    description = described(surrogate, refinement)
    folder.require_free(description)
    if not folder.is_finished:
        lines = descend(surrogate, config, refinement)
        with folder.owned():
            folder.start(description)
            write_lines(folder.metrics, lines)
            tensors = {**surrogate.network.state_dict(), **surrogate.geometry.tensors()}
            folder.write_model(tensors, hardware(target))
    return load(folder.folder, target.type)


def descend(
    surrogate: Surrogate, config: TrainedModel, refinement: Refinement
) -> list[dict[str, float]]:
    """Train a network in place; return the lines of measures, one for every `EPOCH` steps."""
    family = loads_of(surrogate, refinement.family)
    began = time.perf_counter()
    lines: list[dict[str, float]] = []
    descent = Descent(surrogate.body.balanced(), family, refinement)
    optimisers = make_optimisers(surrogate.network.train(), config.training.optimiser)
    progress = Progress(refinement.steps, 0, "steps", f"surrogate refine {config.name}")
    values = []
    for step in range(refinement.steps):
        rate = refinement.learning_rate * (1 - step / refinement.steps)
        set_learning_rate(optimisers, rate)
        surrogate.network.zero_grad(set_to_none=True)
        values.append(descent.differentiate(surrogate, step, config.training.batch_size))
        for each in optimisers:
            each.step()
        progress.update(step + 1)
        if (step + 1) % EPOCH == 0 or step + 1 == refinement.steps:
            if not all_finite(surrogate.network):
                raise WorkError(f"diverged in step {step + 1}; nothing is written")
            seconds = time.perf_counter() - began
            loss, epoch = float(np.mean(values[-EPOCH:])), len(lines) + 1
            lines.append({"epoch": epoch, "train_loss": loss, "seconds": seconds})
    progress.close(f"{time.perf_counter() - began:.0f} s")
    return lines


def described(surrogate: Surrogate, refinement: Refinement) -> RunDescription:
    """Description of the refined run: that of its origin, with the refinement."""
    origin, state = surrogate.description, dict(surrogate.network.state_dict())
    weights = tensor_digest({name: tensor.cpu() for name, tensor in state.items()}, {})
    start = Origin(run=origin.run.name, data=origin.data.digest, weights=weights)
    return origin.model_copy(update={"start_from": start, "refined": refinement})


class Descent:
    """Gradients of the potential energy of random load cases.

    Parameters
    ----------
    equilibrium : Equilibrium
    family : Loads
    refinement : Refinement
        Its seed gives the loads of every step.
    """

    def __init__(self, equilibrium: Equilibrium, family: Loads, refinement: Refinement) -> None:
        self.equilibrium, self.family, self.seed = equilibrium, family, refinement.seed

    def differentiate(self, surrogate: Surrogate, step: int, count: int) -> float:
        """Add the gradients of one batch to the weights; return L, without inverted load cases."""
        forces = self.family.draw(count, np.random.default_rng(stream(self.seed, REFINEMENT, step)))
        given = torch.from_numpy(forces.astype(np.float32)).to(surrogate.network.free.device)
        predicted = surrogate.predictor.network(given).mean  # (members, N, n_nodes, d)
        members = [self.gradient(u, forces) for u in predicted.detach().double().cpu().numpy()]
        gradient = np.stack([slope for slope, _ in members]).astype(np.float32)
        towards = torch.from_numpy(gradient).to(predicted) / count
        torch.autograd.backward((predicted * towards).sum())
        values = np.concatenate([value for _, value in members])
        finite = values[np.isfinite(values)]
        return float(finite.mean()) if len(finite) else np.inf

    def gradient(self, u: Array, f: Array) -> tuple[Array, Array]:
        """Π / (f · K(0)⁻¹ f) of load cases, and its gradient; zero if a cell is inverted.

        Parameters
        ----------
        u, f : array, (N, n_nodes, d)
            In m and N.

        Returns
        -------
        gradient : array, (N, n_nodes, d)
            In 1/m.
        values : array, (N,)
            +∞ if a cell is inverted.
        """
        work = (f * self.equilibrium.linear_response(f)).sum((1, 2))
        r = self.equilibrium.out_of_balance(u, f)
        r[self.equilibrium.inverted(u) > 0] = 0.0
        return r / work[:, None, None], self.equilibrium.potential(u, f) / work
