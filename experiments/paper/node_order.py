"""Other orders of the nodes on the network's grid (Table "order_table", Figure "node_order")."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import rankdata

from experiments.framework.experiment import Experiment, Findings
from experiments.framework.record import Claim, Table, compare
from experiments.framework.resources import Resources
from experiments.measures.errors_on_test_split import MM, split_errors
from experiments.paper.published_numbers import PAPER, PaperErrors
from shared_schema import Grid
from shared_schema.common.drawing import make_figure, styled
from surrogate.learning.data import Geometry

RUNS = {order: f"beam3d_{order}-det" for order in ("preferred", "gmsh", "random")}
PAPER_ORDERS: dict[str, PaperErrors] = {
    "preferred": PAPER.networks["beam3d"]["deterministic"],
    **PAPER.node_orders,
}
SEVERAL = 3.0  # smallest ratio that counts as several times
IntArray = NDArray[np.int64]


def measure(resources: Resources) -> Findings:
    """Measure ē and σ(e) of all three orders, and draw them."""
    errors = {order: split_errors(resources, run) for order, run in RUNS.items()}
    means = {order: MM * e.mean_error for order, e in errors.items()}
    rows, comparisons = [], []
    for order, e in errors.items():
        std, paper = MM * e.std_error, PAPER_ORDERS.get(order)
        papers = (paper.mean_error_mm, paper.std_error_mm) if paper else (None, None)
        rows.append((order, means[order], std, means[order] / means["preferred"], *papers))
        if paper:
            comparisons += [
                compare(f"{order} order: ē", "mm", means[order], paper.mean_error_mm),
                compare(f"{order} order: σ(e)", "mm", std, paper.std_error_mm),
            ]
    geometries = {order: resources.dataset_of(run).geometry for order, run in RUNS.items()}
    return Findings(
        tables=[
            Table(
                caption="Errors of the 3D beam by the order of the nodes on the grid.",
                head=(
                    "order",
                    "ē [mm]",
                    "σ(e) [mm]",
                    "ē / ē of preferred",
                    "paper: ē [mm]",
                    "paper: σ(e) [mm]",
                ),
                rows=tuple(rows),
            )
        ],
        comparisons=comparisons,
        claims=[random_is_worse(means), gmsh_is_between(means)],
        figures={
            "numbers": (
                draw_numbers(geometries),
                "Free end of the 3D beam: at every node the number of the grid point where the "
                "network finds it, counted z fastest; darker where larger. Neighbours in the body "
                "are neighbours on the grid only in the preferred order.",
            )
        },
    )


def random_is_worse(means: dict[str, float]) -> Claim:
    """Test whether the random order is worse by several times; `means` are ē in mm by order."""
    ratio = means["random"] / means["preferred"]
    papers = [PAPER_ORDERS[order].mean_error_mm for order in ("random", "preferred")]
    return Claim(
        what="The error with a random order of nodes is several times that with the preferred one.",
        holds=ratio >= SEVERAL,
        evidence=f"ē is {ratio:.3g} times as large (several: ≥ {SEVERAL:g}); the paper: "
        f"{papers[0] / papers[1]:.3g} times.",
    )


def gmsh_is_between(means: dict[str, float]) -> Claim:
    """Test whether gmsh's order lies between the others; `means` are ē in mm by order."""
    return Claim(
        what="The error with gmsh's order lies between those with the preferred and a random one.",
        holds=means["preferred"] < means["gmsh"] < means["random"],
        evidence="ē = {preferred:.3g}, {gmsh:.3g} and {random:.3g} mm; ".format(**means)
        + "the paper gives no numbers of gmsh's.",
    )


def numbers_at_end(geometry: Geometry) -> IntArray:
    """Numbers of the grid points, x slowest, of the nodes on the end face x = max.

    Returns
    -------
    array of int, (ny, nz)
        Numbers by the places of the nodes in space.
    """
    numbers = np.empty(geometry.grid.nodes, dtype=np.int64)
    numbers[geometry.grid.node_at[geometry.grid.mask]] = np.flatnonzero(geometry.grid.mask)
    in_space = Grid.from_coordinates(geometry.coordinates)
    return np.asarray(numbers[in_space.node_at[-1]])


@styled
def draw_numbers(geometries: dict[str, Geometry]) -> Figure:
    """Draw the numbers of the nodes on the end face, light to dark; one panel for each order."""
    figure = make_figure(9.6, 3.2)
    for axes, (name, geometry) in zip(
        figure.subplots(1, len(geometries)), geometries.items(), strict=True
    ):
        numbers = numbers_at_end(geometry)
        rank = rankdata(numbers).reshape(numbers.shape)
        axes.imshow(rank.T, origin="lower", cmap="Blues", vmax=1.6 * numbers.size)
        for (y, z), number in np.ndenumerate(numbers):
            axes.text(y, z, str(number), ha="center", va="center", fontsize=5.5)
        axes.set(xticks=[], yticks=[], xlabel="y")
        axes.set_title(name, fontsize=10)
        axes.spines[:].set_visible(False)
    figure.axes[0].set_ylabel("z")
    return figure


STUDY = Experiment(
    name="node-order",
    title="Order of the nodes",
    labels=("order_table", "node_order"),
    question="What if the neighbours on the network's grid are not neighbours in the body?",
    measure=measure,
    runs=tuple(RUNS.values()),
)
