r"""Load paths of samples: each sample is a family of solutions around its load.

.. math:: F + t ΔF \mapsto U + t U_1 + t^2 U_2, \qquad t \in [-1, 1]

A training draws one path and one t whenever it takes a sample
(`surrogate.contrib.sample_paths`).

The paths are computed once and kept in ``load_paths/`` in the folder of the dataset, 100 samples a
file. A killed computation is resumed with the next file. The changes of the loads depend on the row
of a sample and on the number of paths only, so that all trainings share the files.

An equilibrium changes with its load, to second order, as

.. math::
    u(f + t Δf) = u + t u_1 + t^2 u_2 + O(t^3), \qquad u_1 = K(u)^{-1} Δf, \qquad
    u_2 = -\tfrac{1}{2} K(u)^{-1} \big(K'(u)[u_1] \, u_1\big)

The second coefficient is a simplified Newton step: with a small h,
:math:`h^2 u_2 ≈ -K(u)^{-1} \big(r(u + h u_1, f + h Δf) - r(u, f)\big)`. One more such
step from the end of a path, t = 1, estimates the remainder there; a path ends where it counts. So K
paths through a solved sample take one factorisation, and 3 K solves with it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from shared_schema.common.errors import InputError
from shared_schema.common.machine import require_memory
from shared_schema.common.progress import Progress
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.data.mirror import fields_with_mirror_images
from surrogate.learning.data.samples import Samples
from surrogate.learning.data.samples_on_disk import SamplesOnDisk
from surrogate.learning.models.model import TrainedModel
from surrogate.learning.networks.field_network import FieldNetwork
from surrogate.learning.runs.split import TrainingSplit
from surrogate.learning.training.data_parallel import Ranks
from surrogate.learning.training.sample_store import SampleStore
from surrogate.mechanics.body.elements_of_case import require_linear_elements
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.equilibrium.newton_steps import norms
from surrogate.mechanics.equilibrium.out_of_balance import Equilibrium
from surrogate.runtime.device import PATHS, stream
from surrogate.runtime.tensor_file import Tensors, load_tensors, save_atomically

Array = NDArray[np.float64]
SMALL, TINY = 0.001, float(np.finfo(np.float64).tiny)  # h, and no division by zero
REMAINDER = 1e-4  # largest one, relative to ‖u‖
HALVINGS = 10  # of a path on which cells are inverted
FOLDER = "load_paths"
IN_A_FILE = 100  # samples
FIELDS = ("change", "first", "second")
SIZE = 0.5  # standard deviation of the changes, relative to that of the forces


@dataclass(frozen=True)
class LoadPaths:
    """K load paths through one equilibrium, for t in [-1, 1].

    Attributes
    ----------
    change : array, (K, n_nodes, d)
        Δf in N.
    first, second : array, (K, n_nodes, d)
        u₁ and u₂ in m.
    """

    change: Array
    first: Array
    second: Array

    def shortened(self, s: Array) -> LoadPaths:
        """Return the parts of the paths up to t = s, (K,), with s as their new end."""
        s = s[:, None, None]
        return LoadPaths(
            np.where(s > 0, s * self.change, 0.0),
            np.where(s > 0, s * self.first, 0.0),
            np.where(s > 0, s**2 * self.second, 0.0),
        )


def follow(equilibrium: Equilibrium, u: Array, f: Array, change: Array) -> LoadPaths:
    """Follow the equilibrium of a body along changes of its load.

    Paths are shortened so that their remainder is about 1e-4 ‖u‖ at most. They have no length
    where the equilibrium is not stable.

    Parameters
    ----------
    equilibrium : Equilibrium
    u : array, (n_nodes, d)
        Equilibrium in m.
    f : array, (n_nodes, d)
        Its forces in N.
    change : array, (K, n_nodes, d)
        Δf in N.
    """
    nothing = np.zeros(change.shape)
    respond = equilibrium.response_at(u)
    if respond is None:
        return LoadPaths(nothing, nothing, nothing)
    here = equilibrium.out_of_balance(u[None], f[None])

    def newton_steps(step: Array, change: Array) -> Array:
        return -respond(equilibrium.out_of_balance(u + step, f + change) - here)

    first = respond(change)
    paths = LoadPaths(change, first, newton_steps(SMALL * first, SMALL * change) / SMALL**2)
    paths = paths.shortened(_reach(equilibrium, u, paths))
    remainder = norms(newton_steps(paths.first + paths.second, paths.change))
    wanted = REMAINDER * np.linalg.norm(u)
    return paths.shortened(np.minimum(1, np.cbrt(wanted / np.maximum(remainder, TINY))))


def _reach(equilibrium: Equilibrium, u: Array, paths: LoadPaths) -> Array:
    """Largest t = 1, 1/2, 1/4, … of every path at which no cell is inverted; 0 if there is none."""
    t = np.ones(len(paths.change))
    for _ in range(HALVINGS):
        s = t[:, None, None]
        bad = equilibrium.inverted(u + s * paths.first + s**2 * paths.second) > 0
        if not bad.any():
            return t
        t[bad] /= 2
    t[bad] = 0
    return t


def neighbours(geometry: Geometry) -> list[NDArray[np.int64]]:
    """Other loadable nodes of the cells around every node, for each of the nodes."""
    found: list[set[int]] = [set() for _ in geometry.coordinates]
    for cell in geometry.cells.tolist():
        loadable = [node for node in cell if geometry.loadable[node]]
        for node in loadable:
            found[node].update(loadable)
    return [np.array(sorted(nodes - {node})) for node, nodes in enumerate(found)]


def random_changes(
    f: Array,
    beside: list[NDArray[np.int64]],
    size: float,
    count: int,
    generator: np.random.Generator,
) -> Array:
    r"""Draw changes of a load that keep its kind: (count, n_nodes, d) in N.

    .. math:: Δf = \sum_a e_a \, ε_a + m_a (e_b - e_a) f_a, \qquad
       ε_a \sim N(0, s^2 I), \quad m_a \sim U(-1, 1)

    over the loaded nodes a, each with a random neighbour b: the forces change, and move.

    Parameters
    ----------
    f : array, (n_nodes, d)
        Forces in N.
    beside : list of array of int
        Loadable neighbours of every node (`neighbours`).
    size : float
        s in N.
    count : int
    generator : numpy.random.Generator
    """
    change = np.zeros((count, *f.shape))
    for path in change:
        for a in np.flatnonzero(f.any(axis=1)):
            path[a] += generator.normal(0.0, size, f.shape[1])
            if len(beside[a]):
                moved = generator.uniform(-1, 1) * f[a]
                path[a] -= moved
                path[generator.choice(beside[a])] += moved
    return change


@dataclass(frozen=True)
class SamplePaths:
    """K load paths of each of N samples, on the grid.

    Attributes
    ----------
    force : Tensor, (N, K, d, nx, ny[, nz])
        ΔF in N; as `FieldNetwork.prepared` returns it, the change of the network's input.
    first, second : Tensor, (N, K, d, nx, ny[, nz])
        U₁ and U₂ in m.
    """

    force: Tensor
    first: Tensor
    second: Tensor

    def __len__(self) -> int:
        return len(self.force)

    def to(self, device: torch.device) -> SamplePaths:
        """Return the same paths on a device."""
        first, second = self.first.to(device), self.second.to(device)
        return SamplePaths(self.force.to(device), first, second)

    def chosen(self, rows: Tensor, path: Tensor) -> SamplePaths:
        """Return one path of each of some samples, (n, d, nx, ny[, nz]), by their numbers."""
        return SamplePaths(self.force[rows, path], self.first[rows, path], self.second[rows, path])

    def with_mirror_images(
        self, geometry: Geometry, axes: tuple[str, ...], key: str
    ) -> SamplePaths:
        """Add the paths of the mirror images of the samples (`surrogate.learning.data.mirror`)."""
        shape = (-1, *self.force.shape[1:])
        fields = [field.flatten(0, 1) for field in (self.force, self.first, self.second)]
        force, first, second = fields_with_mirror_images(fields, geometry, axes, key)
        return SamplePaths(force.reshape(shape), first.reshape(shape), second.reshape(shape))


class AlongPaths:
    """A store whose batches are drawn from the load paths of its samples.

    Parameters
    ----------
    store : SampleStore
        The samples themselves.
    paths : SamplePaths
        Their paths, in the same order.
    """

    def __init__(self, store: SampleStore, paths: SamplePaths) -> None:
        self.home, self._store = store.home, store
        self._paths = paths.to(store.home)

    def batches(self, indices: Iterable[Tensor]) -> Iterator[Samples]:
        """Yield batches, each sample at a random point of a random path."""
        kept = list(indices)
        for rows, samples in zip(kept, self._store.batches(kept), strict=True):
            yield self._moved(rows, samples)

    def _moved(self, rows: Tensor, samples: Samples) -> Samples:
        count, ones = self._paths.force.shape[1], (1,) * (samples.force.ndim - 1)
        path = torch.randint(count, (len(rows),)).to(self.home)
        t = 2 * torch.rand(len(rows)).reshape(-1, *ones).to(samples.force.device) - 1
        moved = self._paths.chosen(rows, path).to(samples.force.device)
        displacement = samples.displacement + t * (moved.first + t * moved.second)
        return Samples(samples.force + t * moved.force, displacement)


def along_load_paths(
    config: TrainedModel, dataset: Dataset, split: TrainingSplit[Samples], ranks: Ranks
) -> Callable[[SampleStore, FieldNetwork], AlongPaths]:
    """Compute missing load paths of the training samples and read all; return who draws batches.

    Collective.
    """
    count, mirrors = config.training.load_paths, config.training.mirrors
    key = f"config '{config.name}': key 'training.load_paths'"

    def compute() -> None:
        if isinstance(dataset.training, SamplesOnDisk):
            raise InputError(f"{key} = {count}: expected 0 of samples on disk")
        require_path_memory(dataset, count, 2 ** len(mirrors) * len(split.train_rows), key)
        compute_missing(dataset, split.train_rows, count)

    ranks.from_first(compute)
    paths = read_paths(dataset, split.train_rows, count)
    key = f"config '{config.name}': key 'training.mirrors'"
    paths = paths.with_mirror_images(dataset.geometry, mirrors, key)
    return lambda store, network: AlongPaths(store, prepared_paths(paths, network))


def prepared_paths(paths: SamplePaths, network: FieldNetwork) -> SamplePaths:
    """Prepare load paths as their samples: what a network is given is linear in the forces."""
    found = network.prepared(Samples(paths.force.flatten(0, 1), paths.first.flatten(0, 1)))
    change = found.force.reshape(*paths.force.shape[:2], *found.force.shape[1:])
    return SamplePaths(change, found.displacement.reshape(paths.first.shape), paths.second)


def require_path_memory(dataset: Dataset, count: int, samples: int, key: str) -> None:
    """Raise InputError if the load paths of some samples take more memory than there is.

    Parameters
    ----------
    dataset : Dataset
    count : int
        Number of paths K of each sample.
    samples : int
    key : str
        Configuration key that asks for them.
    """
    values = count * dataset.geometry.dimension * int(np.prod(dataset.geometry.grid.shape))
    needed = len(FIELDS) * 4 * values * samples
    require_memory(needed, f"{key} = {count}: the paths of {samples} samples")


def read_paths(dataset: Dataset, rows: Tensor, count: int) -> SamplePaths:
    """Read the load paths of some training samples.

    Parameters
    ----------
    dataset : Dataset
    rows : Tensor of int, (N,)
        Rows of the samples in the training split, ascending.
    count : int
        Number of paths K of each sample.

    Raises
    ------
    InputError
        If a file is damaged.
    """
    grid = dataset.geometry.grid
    fields: dict[str, list[Tensor]] = {name: [] for name in FIELDS}
    for number in files_of(rows):
        tensors, _ = load_tensors(path_file(dataset, number, count))
        chosen = rows[rows // IN_A_FILE == number] - number * IN_A_FILE
        for name in FIELDS:
            to_grid = grid.forces_to_grid if name == "change" else grid.to_grid
            fields[name].append(torch.from_numpy(to_grid(tensors[name][chosen].numpy())))
    joined = {name: torch.cat(parts) for name, parts in fields.items()}
    return SamplePaths(joined["change"], joined["first"], joined["second"])


def files_of(rows: Tensor) -> list[int]:
    """Numbers of the files that some rows are in."""
    return torch.unique(rows // IN_A_FILE).tolist()


def path_file(dataset: Dataset, number: int, count: int) -> Path:
    """Return the name of a file, which tells the dataset and the number of paths."""
    folder = dataset.train_on_disk.reader.folder / FOLDER
    return folder / f"{dataset.manifest.digest[:12]}-{count}-{number:05d}.safetensors"


def compute_missing(dataset: Dataset, rows: Tensor, count: int) -> None:
    """Compute the load paths of all files of some rows that are not there; OSError if it cannot.

    Raises
    ------
    InputError
        If the elements of the case are not linear, or its loads have a pressure.
    """
    require_linear_elements(dataset.manifest.case, "load paths")
    if dataset.geometry.pressed is not None:
        raise InputError(
            "key 'training.load_paths': the loads of the case have a pressure that follows the "
            "surface, expected 0; load paths are for dead loads"
        )
    missing = [n for n in files_of(rows) if not path_file(dataset, n, count).is_file()]
    if not missing:
        return
    equilibrium = Equilibrium(dataset.geometry, dataset.material)
    beside = neighbours(dataset.geometry)
    size = SIZE * max(dataset.info.force.max_abs) / 3**0.5
    total = len(dataset.training)
    progress = Progress(len(missing) * IN_A_FILE, 0, "samples", "surrogate train: load paths")
    for done, number in enumerate(missing):
        of_file = torch.arange(number * IN_A_FILE, min((number + 1) * IN_A_FILE, total))
        samples = dataset.nodal_train(of_file)
        found: dict[str, list[Tensor]] = {name: [] for name in FIELDS}
        for place, row in enumerate(of_file.tolist()):
            u, f = samples.displacement[place], samples.force[place]
            generator = np.random.default_rng(stream(PATHS, count, row))
            change = random_changes(f, beside, size, count, generator)
            paths = follow(equilibrium, u, f, change)
            for name in FIELDS:
                found[name].append(torch.from_numpy(getattr(paths, name)).float())
            progress.update(done * IN_A_FILE + place + 1)
        tensors: Tensors = {name: torch.stack(found[name]) for name in FIELDS}
        save_atomically(tensors, path_file(dataset, number, count))
    progress.close("done")
