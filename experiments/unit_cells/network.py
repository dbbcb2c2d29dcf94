"""A U-Net on a grid over the square, trained at the nodes of unit cells of any mesh.

The network sees fields at the points of the grid, zero in the holes, and predicts fields there that
are interpolated at the nodes; its loss is the score (`experiments.unit_cells.unit_cell.scores`),
without the energy. So what it says of points in holes is what the nodes beside them need.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from torch import Tensor
from torch.nn import functional

from experiments.unit_cells.unit_cell import FIELDS, Prediction, UnitCell
from shared_schema import locate
from shared_schema.common import Progress
from surrogate.learning.networks import UNet, UNetConfig

Array = NDArray[np.float64]
POINTS = 64  # of the grid, in each direction
CHANNELS = 6  # inputs
ROUNDING = 1e-6
BATCH, RATE = 8, 2e-3


@dataclass(frozen=True)
class Views:
    """What a network sees of a cell, and what it corrects.

    Attributes
    ----------
    inputs : array, (6, n, n)
    begin : Prediction
        Fields that the network adds its prediction to.
    """

    inputs: NDArray[np.float32]
    begin: Prediction


class OnGrid:
    """Interpolation of a cell's fields on the grid.

    Parameters
    ----------
    cell : UnitCell
    """

    def __init__(self, cell: UnitCell) -> None:
        self.cell = cell
        ticks = np.linspace(0, 1, POINTS)
        places = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
        self.positions = cell.lower + places * cell.sides
        mesh = cell.coordinates, cell.triangles, "triangle"
        triangle, self._weights, outside = locate(self.positions, *mesh)
        self._nodes, self.inside = cell.triangles[triangle], outside < ROUNDING

    def __call__(self, values: Array) -> Array:
        """Values at the nodes, (n_nodes, k), at the points; zero in holes: (k, n, n)."""
        found = np.einsum("pc,pck->kp", self._weights, values[self._nodes]) * self.inside
        return np.asarray(found.reshape(-1, POINTS, POINTS))

    def distance(self) -> Array:
        """Distance from the edge of the next hole, over the side; negative in holes: (1, n, n)."""
        edges = np.sort(self.cell.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        once, times = np.unique(edges, axis=0, return_counts=True)
        edge = np.zeros(len(self.cell.coordinates), dtype=bool)
        edge[once[times == 1]] = True
        holes = self.cell.coordinates[edge & ~self.cell.is_outer]
        away = np.asarray(cKDTree(holes).query(self.positions)[0]) / self.cell.sides.mean()
        return np.where(self.inside, away, -away).reshape(1, POINTS, POINTS)


def geometry_views(cell: UnitCell) -> Views:
    """Distance from the holes, macroscopic stretch U - I and its displacement; corrects that."""
    grid = OnGrid(cell)
    (u11, u12), (_, u22) = cell.stretch_tensor - np.eye(2)
    constant = np.ones((1, POINTS, POINTS))
    stretch = np.concatenate([value * constant for value in (u11, u12, u22)])
    inputs = np.concatenate([grid(cell.homogeneous), grid.distance(), stretch])
    begin = np.zeros((len(cell.coordinates), len(FIELDS)))
    begin[:, :2] = cell.homogeneous
    return Views(inputs.astype(np.float32), Prediction(begin, 0.0))


def mechanics_views(cell: UnitCell, begin: Prediction, gradient: Array) -> Views:
    """Fluctuation and gradient, (n_triangles, 4), of a displacement; corrects its fields."""
    fluctuation = begin.fields[:, :2] - cell.homogeneous
    inputs = OnGrid(cell)(np.column_stack([fluctuation, cell.at_nodes(gradient)]))
    return Views(inputs.astype(np.float32), begin)


class FieldPredictor:
    """A trained network with its scales.

    Parameters
    ----------
    cells : sequence of UnitCell
        To train on.
    views : sequence of Views
        Of each of them.
    channels : int
        Of the finest level.
    epochs : int
    seed : int
    """

    def __init__(
        self,
        cells: Sequence[UnitCell],
        views: Sequence[Views],
        channels: int,
        epochs: int,
        seed: int,
    ) -> None:
        torch.manual_seed(seed)
        config = UNetConfig(
            levels=4,
            channels=channels,
            activation="gelu",
            batch_norm=False,
            inputs=("force", "linear_gradient"),  # of six channels together
        )
        assert config.input_channels(2) == CHANNELS
        self.network = UNet(2, len(FIELDS), config)
        inputs = torch.from_numpy(np.stack([view.inputs for view in views]))
        self.input_scale = inputs.square().mean((0, 2, 3), keepdim=True).sqrt()
        pairs = zip(cells, views, strict=True)
        rest = [cell.solution.fields - view.begin.fields for cell, view in pairs]
        self.output_scale = torch.from_numpy(np.sqrt(np.square(np.concatenate(rest)).mean(0)))
        largest = np.stack([np.abs(cell.solution.fields).max(axis=0) for cell in cells])
        weights = (self.output_scale / torch.from_numpy(largest)).square().float()
        targets = [(torch.from_numpy(each) / self.output_scale).float() for each in rest]
        places = [places_of(cell) for cell in cells]
        self._train(inputs / self.input_scale, places, targets, weights, epochs)

    def _train(
        self,
        inputs: Tensor,
        places: Sequence[Tensor],
        targets: Sequence[Tensor],
        weights: Tensor,
        epochs: int,
    ) -> None:
        optimizer = torch.optim.AdamW(self.network.parameters(), lr=RATE)
        steps = epochs * -(-len(inputs) // BATCH)
        schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, RATE, total_steps=steps)
        progress = Progress(epochs, 0, "epochs", "U-Net")
        for epoch in range(epochs):
            total = 0.0
            for batch in torch.split(torch.randperm(len(inputs)), BATCH):
                found = self.network(inputs[batch])
                loss = torch.zeros(())
                for row, number in enumerate(batch.tolist()):
                    at_nodes = interpolated(found[row], places[number])
                    squares = (at_nodes - targets[number]).square().mean(0)
                    loss = loss + (squares * weights[number]).mean() / len(batch)
                optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
                optimizer.step()
                schedule.step()
                total += float(loss.detach()) * len(batch)
            progress.update(epoch + 1, f"score of the fields {np.sqrt(total / len(inputs)):.4f}")
        progress.close("done")
        self.network.eval()

    @torch.no_grad()
    def predict(self, cell: UnitCell, view: Views) -> Prediction:
        """Predict fields and energy of a cell; the outer edge moves as it must."""
        inputs = torch.from_numpy(view.inputs)[None] / self.input_scale
        found = interpolated(self.network(inputs)[0], places_of(cell))
        fields = view.begin.fields + (found * self.output_scale).numpy()
        fields[cell.is_outer, :2] = cell.homogeneous[cell.is_outer]
        return Prediction(fields, cell.mean(fields[:, -1]))


def places_of(cell: UnitCell) -> Tensor:
    """Places of the nodes for `interpolated`, (1, 1, n_nodes, 2)."""
    places = 2 * (cell.coordinates - cell.lower) / cell.sides - 1
    return torch.from_numpy(places[:, ::-1].copy()).float()[None, None]  # the last axis first


def interpolated(field: Tensor, places: Tensor) -> Tensor:
    """Fields at the points, (k, n, n), bilinearly at the nodes, (n_nodes, k)."""
    return functional.grid_sample(field[None], places, align_corners=True)[0, :, 0].T
