r"""Training without solutions: by the potential energy of random load cases.

In equilibrium the potential energy :math:`Π(u) = E(u) - f · u` is lowest
(`surrogate.mechanics.equilibrium`). A network u(f; θ) is trained by its mean over random load
cases. Its gradient with respect to a displacement is the force out of balance, r = ∂Π/∂u. In the
Euclidean inner product r consists mostly of stiff directions; in that of the undeformed body's
energy it is :math:`K(0)^{-1} r`, a displacement. With the latter,

.. math:: \frac{∂L}{∂θ} = \frac{1}{N} \sum_f \frac{K(0)^{-1} r \cdot ∂u/∂θ}{‖K(0)^{-1} f‖}

where every load case is weighted by the inverse size of its linear response. Load cases with an
inverted cell, where Π is infinite, are left out. No solution of the finite elements is needed.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from shared_schema.common.command_line import Progress
from shared_schema.common.errors import InputError, WorkError
from surrogate.data.random_loads import RandomLoads, random_loads
from surrogate.inference.prediction import Surrogate, load
from surrogate.mechanics.equilibrium import Equilibrium, norms
from surrogate.models.model import TrainedModel
from surrogate.optim.optimisers import make_optimisers, set_learning_rate
from surrogate.runs.description import Origin, Refinement, RunDescription
from surrogate.runs.folder import RunFolder
from surrogate.runs.tensor_file import tensor_digest
from surrogate.seeds import REFINEMENT, stream
from surrogate.training.train import all_finite, write_model

Array = NDArray[np.float64]
EPOCH = 100  # steps between two lines of measures


def refine(run: Path, out: RunFolder, refinement: Refinement, device: torch.device) -> float:
    """Go on training a run without solutions; write the result into a new run folder.

    Parameters
    ----------
    run : Path
        Run folder, or the name of a network that comes with the package.
    out : RunFolder
    refinement : Refinement
        Family of loads, steps, learning rate and seed.
    device : torch.device

    Returns
    -------
    float
        Relative out-of-balance energy norm of the last steps, as `Descent` measures it.

    Raises
    ------
    InputError
        If the network predicts standard deviations or is fitted directly, its run does not name its
        material, or the folder belongs to another run.
    WorkError
        If the training diverges; nothing is written then.
    """
    surrogate = load(run, device.type)
    config = surrogate.description.run
    if not isinstance(config, TrainedModel) or surrogate.is_probabilistic:
        raise InputError(
            f"{run}: config '{config.name}', expected a deterministic network that was trained"
        )
    data = surrogate.description.data
    family = random_loads(
        refinement.family, surrogate.geometry, data.info.force.max_abs, data.load_numbers
    )
    description = described(surrogate, refinement)
    out.require_free(description)
    if out.is_finished:
        raise InputError(f"--out '{out.folder}': refined already, expected a new folder")
    began = time.perf_counter()
    lines: list[dict[str, float]] = []
    descent = Descent(surrogate.balanced(), family, refinement)
    optimiser = config.training.optimiser
    optimisers = make_optimisers(surrogate.network.train(), optimiser)
    progress = Progress(refinement.steps, 0, "steps", f"surrogate refine {config.name}")
    sizes = []
    for step in range(refinement.steps):
        rate = refinement.learning_rate * (1 - step / refinement.steps)
        set_learning_rate(optimisers, rate)
        surrogate.network.zero_grad(set_to_none=True)
        sizes.append(descent.differentiate(surrogate, step, config.training.batch_size))
        for each in optimisers:
            each.step()
        progress.update(step + 1)
        if (step + 1) % EPOCH == 0 or step + 1 == refinement.steps:
            if not all_finite(surrogate.network):
                raise WorkError(f"diverged in step {step + 1}; nothing is written")
            seconds = time.perf_counter() - began
            loss, epoch = float(np.mean(sizes[-EPOCH:])), len(lines) + 1
            lines.append({"epoch": epoch, "train_loss": loss, "seconds": seconds})
    progress.close(f"{time.perf_counter() - began:.0f} s")
    with out.owned():
        out.start(description)
        for line in lines:
            out.append_metric_line(line)
        tensors = {**surrogate.network.state_dict(), **surrogate.geometry.tensors()}
        write_model(out, device, tensors)
    return float(lines[-1]["train_loss"])


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
    family : RandomLoads
    refinement : Refinement
        Its seed gives the loads of every step.
    """

    def __init__(
        self, equilibrium: Equilibrium, family: RandomLoads, refinement: Refinement
    ) -> None:
        self.equilibrium, self.family, self.seed = equilibrium, family, refinement.seed

    def differentiate(self, surrogate: Surrogate, step: int, count: int) -> float:
        """Add the gradients of one batch to the weights.

        Returns
        -------
        float
            Median of :math:`(r · K(0)^{-1} r / f · K(0)^{-1} f)^{1/2}` over the batch.
        """
        forces = self.family.draw(count, np.random.default_rng(stream(self.seed, REFINEMENT, step)))
        given = torch.from_numpy(forces.astype(np.float32)).to(surrogate.network.free.device)
        predicted = surrogate.nodal_network(given).mean  # (members, N, n_nodes, d)
        members = [self.direction(u, forces) for u in predicted.detach().double().cpu().numpy()]
        direction = np.stack([slope for slope, _ in members]).astype(np.float32)
        towards = torch.from_numpy(direction).to(predicted) / count
        torch.autograd.backward((predicted * towards).sum())
        return float(np.median([sizes for _, sizes in members]))

    def direction(self, u: Array, f: Array) -> tuple[Array, Array]:
        """K(0)⁻¹ r over ‖K(0)⁻¹ f‖, zero if a cell is inverted, and the relative energy norm of r.

        Parameters
        ----------
        u, f : array, (N, n_nodes, d)
            In m and N.

        Returns
        -------
        direction : array, (N, n_nodes, d)
        sizes : array, (N,)
        """
        r, linear = self.equilibrium.out_of_balance(u, f), self.equilibrium.linear_response(f)
        r[self.equilibrium.inverted(u) > 0] = 0.0
        slope = self.equilibrium.linear_response(r)
        sizes = np.sqrt((r * slope).sum((1, 2)) / (f * linear).sum((1, 2)))
        return slope / norms(linear)[:, None, None], sizes
