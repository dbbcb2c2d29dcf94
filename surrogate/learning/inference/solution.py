"""The solution of one load case, as `Surrogate.solve` returns it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.solution_file import write_solution
from shared_schema.common.units import SI, Units
from surrogate.learning.probabilistic.distribution import Distribution
from surrogate.mechanics.body.geometry import Geometry
from surrogate.mechanics.descent.driven_body import longest
from surrogate.mechanics.descent.first_direction import exceeds_motion

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from surrogate.mechanics.certify.certificate_protocol import ErrorCertificate
    from surrogate.mechanics.certify.correction import Correction
    from surrogate.mechanics.descent.descent import Descent
    from surrogate.mechanics.touch.touch import TouchFrame

Array = NDArray[np.float64]
FIELDS = (  # in the order of a solution file; those that are None are left out
    "displacement",
    "std",
    "std_epistemic",
    "std_aleatoric",
    "lower",
    "upper",
    "estimated_error",
    "half_width",
    "reaction",
)
WIDE = 0.01  # of the largest displacement: a tolerance in m beyond which its share is said
OF_STRAIN = ("deformation_gradient", "jacobian")  # no stresses


@dataclass(frozen=True, repr=False)
class Solution:
    """Displacement of a body under one load, with what is known of its error.

    Attributes
    ----------
    geometry : Geometry
        Mesh and supports.
    case : str
        Name of the body.
    force : array, (n_nodes, d)
        Nodal forces in N; of pressures, those on the undeformed body.
    force_between : array, (n_between, d), or None
        Forces in N on points of the elements between the nodes, which `force` contains; None for
        elements without such points.
    displacement : array, (n_nodes, d)
        In m; the equilibrium of the finite elements if the prediction is corrected, the state that
        directions have reached if it is driven towards it.
    predicted : array, (n_nodes, d)
        The network's displacement in m.
    distribution : Distribution or None
        The network's standard deviations in m; None if it predicts none, or its displacement is
        corrected or was not within the tolerance.
    interval : tuple of two arrays (n_nodes, d), or None
        Lower and upper ends of conformal intervals in m.
    correction : Correction or None
    certificate : ErrorCertificate or None
        `Certificate` (full) or `Bounds` (fast) of the displacement.
    half_width : array, (n_nodes, d), or None
        Half widths in m of the intervals of all components: the network's standard deviations, with
        the size of the fast certificate; infinite where it gives no bound. None if the network
        predicts none, the run has no such certificate, or the displacement is not the predicted.
    tolerance : float or None
        Largest error of a node that is to be certified, in m; without a certificate, the one that
        directions aim at, relative to the largest displacement.
    stresses : dict of str to array, (n_cells, …)
        By the names of `shared_schema.common.bodies.equilibrium`; empty if not asked for.
    reaction : array, (n_nodes, d), or None
        Forces of the supports on the body in N.
    notes : tuple of str
        Nodes that forces were moved to.
    outside_training : tuple of str
        What is unlike the forces of the training, so that the prediction may be wrong.
    units : Units
        Labels of all numbers, for messages and figures.
    grips : array, (n_places, d), or None
        Resultants of the forces at held places in N, which `force` contains; None without any.
    contact : TouchFrame or None
        Forces of a tool in N, which `force` contains, and how deep nodes are inside it in m.
    descent : Descent or None
        How directions ended (`surrogate.mechanics.descent`): their number, the estimated error in
        m, and whether the tolerance was reached; None if they were not asked for.
    one_direction : array, (n_nodes, d), or None
        Estimate of the displacement minus the true one in m by the first direction, infinite if a
        cell is inverted (`surrogate.mechanics.descent.first_direction`). None where a certificate,
        directions or a correction tell more, of a body whose forces the learner does not know, and
        of a load like those of a training on a large body whose stiffness nothing else needs.
    """

    geometry: Geometry
    case: str
    force: Array
    displacement: Array
    predicted: Array
    distribution: Distribution | None
    interval: tuple[Array, Array] | None
    correction: Correction | None
    certificate: ErrorCertificate | None
    half_width: Array | None
    tolerance: float | None
    stresses: dict[str, Array]
    reaction: Array | None
    notes: tuple[str, ...]
    outside_training: tuple[str, ...]
    units: Units = SI
    descent: Descent | None = None
    grips: Array | None = None
    contact: TouchFrame | None = None
    force_between: Array | None = None
    one_direction: Array | None = None

    @property
    def load(self) -> Array:
        """All forces in N, those between the nodes after the nodal ones: what `certify` takes."""
        parts = [self.force] if self.force_between is None else [self.force, self.force_between]
        return np.concatenate(parts)

    @property
    def largest(self) -> str:
        """The largest displacement, and where it is."""
        length = np.linalg.norm(self.displacement, axis=1)
        at = ", ".join(f"{x:.4g}" for x in self.geometry.coordinates[length.argmax()])
        return f"{self.units.written(length.max())} at ({at}) {self.units.length}"

    @property
    def std(self) -> Array | None:
        """Total standard deviation in m, (n_nodes, d)."""
        return None if self.distribution is None else self.distribution.std

    @property
    def std_epistemic(self) -> Array | None:
        """Standard deviation in m that random weights cause, (n_nodes, d)."""
        return None if self.distribution is None else self.distribution.std_epistemic

    @property
    def std_aleatoric(self) -> Array | None:
        """Standard deviation in m that noise of the data causes, (n_nodes, d)."""
        return None if self.distribution is None else self.distribution.std_aleatoric

    @property
    def lower(self) -> Array | None:
        """Lower ends of conformal intervals in m, (n_nodes, d)."""
        return None if self.interval is None else self.interval[0]

    @property
    def upper(self) -> Array | None:
        """Upper ends of conformal intervals in m, (n_nodes, d)."""
        return None if self.interval is None else self.interval[1]

    @property
    def estimated_error(self) -> Array | None:
        """Estimate of the displacement minus the true one in m, (n_nodes, d)."""
        return None if self.certificate is None else self.certificate.error

    @property
    def refusal(self) -> str | None:
        """Why the displacement is not within `tolerance`; None if it is, or not asked.

        Without a tolerance any error is small enough that is no longer than the displacement, and
        than the true one. A state with inverted elements, an estimate that does not settle, and a
        fast certificate without a bound are never certified. Without a certificate, it is the
        estimate of the directions that may not be within the tolerance.
        """
        if self.certificate is not None:
            most = np.inf if self.tolerance is None else self.tolerance
            return self.certificate.refusal(most) or self._excess
        if self.descent is not None and self.descent.reached is False:
            return self.descent.refusal(self.units)
        return self._excess

    @property
    def _excess(self) -> str | None:
        """How forces are out of balance by more than the body moves; None if they are not."""
        error = self.one_direction if self.certificate is None else self.certificate.error
        if error is None or not exceeds_motion(error, self.displacement):
            return None
        if not np.isfinite(error).all():
            return "inverted elements"
        return (
            "the forces are out of balance by more than the body moves: estimated error "
            f"{self.units.written(longest(error))}, largest displacement {self.largest}"
        )

    @property
    def verdict(self) -> Literal["certified", "not certified"] | None:
        """Whether no node's error is above `tolerance`.

        None if there is no tolerance, unless the displacement is certified for none, and without a
        certificate, unless its forces are out of balance by more than it moves.
        """
        if self.certificate is None:
            return None if self._excess is None else "not certified"
        if self.refusal is not None:
            return "not certified"
        return None if self.tolerance is None else "certified"

    def fields(self) -> dict[str, Array]:
        """Copies of the fields at the nodes by their names in a solution file, (n_nodes, d)."""
        found = {"force": self.force}
        for name in FIELDS:
            values = getattr(self, name)
            if values is not None:
                found[name] = values
            if name == "displacement" and not np.array_equal(values, self.predicted):
                found["predicted"] = self.predicted
        return {name: values.copy() for name, values in found.items()}

    @checked_arguments
    def save(self, path: str | Path) -> None:
        """Write the fields of nodes and cells to a file that ends in .npz, .vtu or .xdmf.

        Raises
        ------
        InputError
            If the file's name has another end, or its folder does not exist.
        """
        mesh = self.geometry.coordinates, self.geometry.cells, self.geometry.cell_type
        between = self.force_between
        between = None if between is None or not between.any() else between
        write_solution(Path(path), *mesh, self.fields(), self.stresses, between)

    def plot(self) -> Figure:
        """Draw the deformed body over the undeformed one, with the forces.

        Colours show, at the nodes, the estimated error; the standard deviation if there is no
        certificate; or the displacement.
        """
        from shared_schema.common.drawing.mesh_drawing import deformed_figure

        body = self.geometry, self.displacement, self.force
        if self.certificate is not None and np.isfinite(self.certificate.error).all():
            return deformed_figure(*body, self.certificate.error, "estimated error of a node")
        if self.std is not None:
            return deformed_figure(*body, self.std, r"standard deviation $\|\sigma\|_2$")
        return deformed_figure(*body)

    def summary(self) -> str:
        """Describe in a line what was done, and with what result: one estimate of the error."""
        parts = ["predicted"]
        if self.correction is not None:
            parts.append(self.correction.summary())
        if self.descent is not None:
            parts.append(self.descent.summary(None if self.certificate else self.units))
        if self.certificate is not None:
            parts.append(self.certificate.summary())
        elif self.descent is None and self.one_direction is not None:
            error = longest(self.one_direction)
            size = f"estimated error {self.units.written(error)} by one direction"
            parts.append(size if np.isfinite(error) else "inverted elements")
        if self.verdict == "certified" and self.tolerance is not None:
            share = self.tolerance / (longest(self.displacement) or np.inf)
            of_all = f", {share:.0%} of the largest displacement" if share > WIDE else ""
            parts.append(f"certified within {self.units.written(self.tolerance)}{of_all}")
        elif self.verdict is not None:
            parts.append(self.verdict)
        if self.stresses:
            mises = self.stresses["von_mises"][self.stresses["jacobian"] > 0]
            parts.append(
                f"largest von Mises stress {mises.max(initial=0.0):.4g} {self.units.stress}"
            )
        return ", ".join(parts)

    def __repr__(self) -> str:
        """Describe body, load, displacement, error and verdict in a few lines."""
        loaded = int(self.force.any(axis=1).sum())
        total = ", ".join(f"{component:.4g}" for component in self.force.sum(axis=0))
        units, nodes = self.units, "node" if loaded == 1 else "nodes"
        lines = [
            f"Solution({self.case}, {len(self.force)} nodes)",
            f"load: {loaded} loaded {nodes}, resultant ({total}) {units.force}",
            f"largest displacement: {self.largest}",
            self.summary(),
        ]
        if self.std is not None:
            largest = np.linalg.norm(self.std, axis=1).max()
            lines.append(f"largest standard deviation: {self.units.written(largest)}")
        if self.refusal is not None:
            lines.append(f"{self.verdict or 'not reached'}: {self.refusal}")
        if self.grips is not None:
            from surrogate.mechanics.touch.grip import held_line

            lines += [held_line(reaction, units) for reaction in self.grips]
        if self.contact is not None:
            from shared_schema.tools import contact_line

            lines.append(contact_line(self.contact, units))
        lines += [*self.notes, *(f"warning: {text}" for text in self.outside_training)]
        return "\n  ".join(lines)


def stiffened(solution: Solution, factor: float) -> Solution:
    """The solution of a body that is stiffer by a factor, from that of forces divided by it."""
    contact, correction = solution.contact, solution.correction
    if contact is not None:
        contact = replace(contact, force=contact.force * factor)
    if correction is not None:
        correction = replace(correction, residual_norm=correction.residual_norm * factor)
    return replace(
        solution,
        force=solution.force * factor,
        force_between=None if solution.force_between is None else solution.force_between * factor,
        stresses={
            name: values if name in OF_STRAIN else values * factor
            for name, values in solution.stresses.items()
        },
        reaction=None if solution.reaction is None else solution.reaction * factor,
        grips=None if solution.grips is None else solution.grips * factor,
        contact=contact,
        correction=correction,
    )
