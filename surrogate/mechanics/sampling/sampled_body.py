"""A body with the load cases that its case draws, and their equilibria.

The load cases are those of `datagen run` with the same seed and number. A load series predicts,
directions go on to the equilibrium within the case's tolerance
(`surrogate.mechanics.descent.equilibria`), and where they do not get there, a correction does. The
elements are those of the finite elements, and so are the equilibria, to rounding.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.sparse import coo_array

from shared_schema.common.bodies.equilibrium import ForceTolerance
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError, WorkError
from shared_schema.common.units import Units
from shared_schema.dataset_reader import DatasetReader
from shared_schema.loads import Load as DrawnLoad
from shared_schema.loads import LoadFamily, LoadsTogether, load_family
from shared_schema.loads.together import placed_loads
from shared_schema.manifest import digest_of
from shared_schema.samples.dataset_settings import DatasetSettings
from shared_schema.samples.results import Result, SolveReport, not_begun
from shared_schema.stiffness import Stiffness
from surrogate.mechanics.body.elements_of_case import loads_of_before
from surrogate.mechanics.certify.correction import correct
from surrogate.mechanics.descent.directions import Asking
from surrogate.mechanics.descent.equilibria import Equilibrated, equilibria, sought
from surrogate.mechanics.equilibrium.following_loads import FollowingLoads
from surrogate.mechanics.series.body_series import BodySeries
from surrogate.mechanics.statics.body import Body
from surrogate.mechanics.statics.load import Load
from surrogate.mechanics.statics.prediction import Series

Array = NDArray[np.float64]
ORDER, PREDICTED = 4, 32  # of the series' last term, and loads that are predicted together
CONVERGED, DIVERGED = 2, -5  # PETSc's reasons: the tolerance is met, too many iterations


@dataclass(frozen=True)
class RecordedCase:
    """The case of a dataset as its manifest has it.

    Attributes
    ----------
    content : mapping
    """

    content: Mapping[str, Any]

    @property
    def dataset(self) -> DatasetSettings:
        """Number of samples, seed and shards."""
        return validate(DatasetSettings, self.content["dataset"], "dataset")

    @property
    def units(self) -> Units:
        """Labels of its units."""
        return Units.of_case(self.content)

    @property
    def load(self) -> LoadFamily | tuple[LoadFamily, ...]:
        """Load families; InputError unless they are forces and pressures of shipped families."""
        given = self.content["load"]
        try:
            families = [
                load_family(each) for each in (given if isinstance(given, list) else [given])
            ]
        except ValueError as error:
            raise InputError(f"key 'load': {error}") from None
        for family in families:
            if family.touches or any(family.moves(3)):
                raise InputError(
                    f"key 'load': family '{family.family}': expected forces and pressures; "
                    "`datagen run` has samples of tools and prescribed displacements"
                )
        return tuple(families) if isinstance(given, list) else families[0]

    def plain(self) -> dict[str, Any]:
        """The whole configuration."""
        return dict(self.content)

    def digest(self) -> str:
        """SHA-256 of it."""
        return digest_of(self.content)


@dataclass
class SampledBody:
    """A body whose load cases are drawn and solved.

    Attributes
    ----------
    case : RecordedCase
    body : Body
    mesh : mapping of str to array
        Arrays of the mesh, as every shard holds them.
    loads : LoadsTogether
        The load cases by their number.
    forces : "consistent" or None
        As of a manifest.
    """

    case: RecordedCase
    body: Body
    mesh: Mapping[str, Any]
    loads: LoadsTogether
    forces: Literal["consistent"] | None

    @classmethod
    def read(cls, folder: Path, samples: int, seed: int | None = None) -> SampledBody:
        """Read the body of any dataset, for so many samples, with the seed of its case or another.

        Raises
        ------
        InputError
            If there is none, or its case asks for what the learner does not solve.
        """
        reader = DatasetReader(folder)
        content = dict(reader.manifest.case)
        given = {"samples": samples} | ({} if seed is None else {"seed": seed})
        content["dataset"] = {**content.get("dataset", {}), **given}
        stability = content.get("solver", {}).get("stability", "follow")
        if stability != "follow":
            raise InputError(
                f"key 'solver.stability' = '{stability}': expected 'follow', an unstable "
                "equilibrium is left for a stable one"
            )
        mesh = {name: a for name, a in reader.body.items() if name.startswith("mesh/")}
        case, body = RecordedCase(content), Body.read(folder)
        if said := loads_of_before(body.geometry):
            raise InputError(f"{folder}: {said}")
        of, groups = body.geometry, body.geometry.groups
        raw = RawMesh(
            of.coordinates,
            of.cells,
            of.cell_type,
            {name: np.flatnonzero(members) for name, members in groups.items()},
            counted_from=(),
            parts=of.group_parts,
        )
        loads = placed_loads(case.load, case.dataset.seed, raw, of.held, of.loaded_points)
        return cls(case, body, mesh, loads, reader.manifest.forces)

    @cached_property
    def _series(self) -> Series:
        terms = BodySeries(self.body.equilibrium, ORDER, precision=torch.float32)
        return Series(self.body, terms=terms)

    @cached_property
    def _tolerance(self) -> ForceTolerance:
        return ForceTolerance.of_case(self.case.content)

    def load(self, drawn: Sequence[DrawnLoad]) -> Load:
        """Drawn load cases as mechanics has them."""
        body, points = self.body.geometry, self.loads.points
        dead = np.zeros((len(drawn), *self.loads.positions.shape))
        for forces, each in zip(dead, drawn, strict=True):
            forces[each.nodes] = each.forces
            if each.between is not None and points is not None:
                forces[points.nodes :] = each.between
        if not self.loads.surfaces:
            return Load(dead)
        pressures = np.stack([each.pressures for each in drawn])
        return Load(dead, FollowingLoads.of(body, pressures))

    def of_shape(self, values: Array) -> SampledBody:
        """The body in the shape of some parameters, (n_parameters,)."""
        geometry = self.body.geometry.shaped(values)
        body, loads = Body(geometry, self.body.case), self.loads.on(geometry.coordinates)
        return replace(self, body=body, loads=loads)

    def solved(self, numbers: Sequence[int]) -> Iterator[Result]:
        """Draw and solve load cases, and yield the results as they come."""
        geometry = self.body.geometry
        if geometry.shapes is None:
            yield from self._solved(numbers)
            return
        for number in numbers:
            values = geometry.shapes.drawn(self.loads.seed, number)
            tangled = geometry.shapes.problem(values, geometry.cells, geometry.cell_type)
            if tangled is None:
                yield from self.of_shape(values)._solved([number])
            else:
                yield not_begun(number, self.loads[number], tangled)

    def _solved(self, numbers: Sequence[int]) -> Iterator[Result]:
        """Solve load cases of one shape."""
        drawn = [self.loads[number] for number in numbers]
        loads = self.load(drawn)
        searches, compliance = self._searches(self._series, loads), self.body.driven_body.compliance
        began = time.perf_counter()
        for place, found in equilibria(compliance, searches):
            now = time.perf_counter()
            yield self._result(numbers[place], drawn[place], loads[place], found, now - began)
            began = time.perf_counter()

    def _searches(self, series: Series, loads: Load) -> Iterator[Asking[Equilibrated | None]]:
        """Predict some loads at a time, and begin their searches."""
        for start in range(0, len(loads.dead), PREDICTED):
            some = loads[start : start + PREDICTED]
            for row, predicted in enumerate(series.respond(some)[0]):
                load = some[row]
                body = self.body.driven_body.under(load.following)
                yield sought(body, load.dead, predicted, self._tolerance)

    def _result(
        self, number: int, drawn: DrawnLoad, load: Load, found: Equilibrated | None, seconds: float
    ) -> Result:
        """What directions have found, or else a correction."""
        began, grip = time.perf_counter(), None if drawn.is_dead else self._no_grip
        if found is None:
            predicted, body = self._series.respond(load)[0], self.body.under(load.following)
            try:
                by = correct(body, load.dead, predicted, self._tolerance)
            except WorkError as error:
                report = SolveReport(False, DIVERGED, str(error), 0.0, 0, 1, 0, 0.0)
                return Result(number, drawn, grip, None, predicted, report, seconds)
            found = Equilibrated(by.displacement, by.iterations, by.residual_norm)
            seconds += time.perf_counter() - began
        report = SolveReport(True, CONVERGED, "", 1.0, 1, 0, found.directions, found.residual_norm)
        return Result(number, drawn, grip, None, found.displacement, report, seconds)

    @cached_property
    def _no_grip(self) -> Array:
        return np.zeros(self.loads.positions.shape)

    @property
    def stiffness(self) -> Stiffness | None:
        """K(0) in N/m without supports; None of elements with unknowns beside those of nodes."""
        body = self.body.equilibrium
        if body.points is not None or self.body.geometry.shapes is not None:
            return None
        cells, d = body.geometry.cells, body.geometry.dimension
        of_cell = (cells[:, :, None] * d + np.arange(d)).reshape(len(cells), -1)
        shape = len(cells), of_cell.shape[1], of_cell.shape[1]
        rows = np.broadcast_to(of_cell[:, :, None], shape).ravel()
        columns = np.broadcast_to(of_cell[:, None], shape).ravel()
        values = body.solid.stiffness_at_rest()[0].numpy().ravel()
        matrix = coo_array((values, (rows, columns)), shape=(body.free.size,) * 2).tocsr()
        matrix.sum_duplicates()
        return Stiffness(
            matrix.data, matrix.indices.astype(np.int64), matrix.indptr.astype(np.int64)
        )


def software() -> dict[str, str]:
    """Versions by name of software, as a manifest stores them."""
    import h5py

    from surrogate import __version__

    return {
        "surrogate": __version__,
        "python": platform.python_version(),
        "h5py": h5py.__version__,
        "numpy": np.__version__,
        "torch": torch.__version__,
    }
