"""Export of a trained network to one file that needs no code of this project: ONNX or ``.pt2``.

The input is ``force`` in newtons, (samples, n_nodes, d) float32, for any number of samples. The
outputs are ``displacement`` and, for probabilistic networks, standard deviations, of the same
shape in metres. The file contains scales, supports and the map between mesh and grid. With
directions (`surrogate.mechanics.descent.fixed_directions`), the outputs are ``displacement`` and,
of every sample, ``estimate``.
"""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from threading import RLock
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.export import Dim, ExportedProgram

from shared_schema.common.arguments import checked_arguments
from shared_schema.common.errors import InputError, WorkError, first_line
from shared_schema.common.files import complete_or_absent, require_writable
from shared_schema.common.machine import require_memory
from shared_schema.common.solution_file import require_suffix
from surrogate.learning.data.case_loads import random_loads
from surrogate.learning.inference.loading import load
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.learning.networks.nodal_network import NodalNetwork
from surrogate.learning.networks.reduced_network import ReducedNetwork
from surrogate.learning.probabilistic.distribution import Moments
from surrogate.learning.probabilistic.likelihoods import Prediction
from surrogate.learning.probabilistic.stochastic_passes import require_passes
from surrogate.mechanics.descent.fixed_directions import FixedDirections, require_exportable
from surrogate.mechanics.equilibrium.block_solve import BlockSolve
from surrogate.mechanics.equilibrium.compliance import Compliance
from surrogate.mechanics.equilibrium.linear_response import LinearResponse
from surrogate.mechanics.series.series_response import SeriesResponse

Format = Literal["onnx", "pt2"]
Fields = dict[str, Tensor]
ONNX_PACKAGES = ("onnx", "onnxscript", "onnxruntime")
ONNX_OPSET = 18
ONNX_LIMIT = 2e9  # bytes in one file
TOLERANCE, ROUGH_TOLERANCE = 1e-4, 1e-3
CHECKED_BATCHES, CHECKED_LOADS = (1, 8), 4  # random loads, on so many nodes at most
PRECISION = 2.0**-23  # relative, of numbers in single precision
_EXPORTS = RLock()  # PyTorch's exporters and settings of warnings are for one thread at a time


class NodalFunction(nn.Module):
    """The exported function: it maps nodal forces to named nodal fields.

    Parameters
    ----------
    network : NodalNetwork
    passes : int, optional
        Number T of drawn passes; None for the mean weights of every member.
    directions : FixedDirections, optional
        What drives the displacements towards the equilibrium.
    """

    def __init__(
        self, network: NodalNetwork, passes: int | None, directions: FixedDirections | None = None
    ) -> None:
        super().__init__()
        self.network, self.passes, self.directions = network, passes, directions

    def forward(self, force: Tensor, response: Tensor | None = None) -> Fields:
        """Predict fields in m from forces in N, each (N, n_nodes, d).

        The linear response to the forces in m, of the same shape, is computed unless it is given.
        """
        fields = self._predicted(force, response)
        if self.directions is None:
            return fields
        displacement, estimate = self.directions(force, fields["displacement"])
        return {"displacement": displacement.float(), "estimate": estimate.float()}

    def _predicted(self, force: Tensor, response: Tensor | None) -> Fields:
        """Fields of the network."""
        if self.passes is None and self.network.network.members == 1:
            mean, std = self.network(force, 1, response)
            return {"displacement": mean[0]} | ({} if std is None else {"std": std[0]})
        _, factor = self.network.factors(force)
        passes = self.passes or 1
        mean, std = self.network(force, passes, response)
        in_double = Prediction(mean.double(), None if std is None else std.double())
        moments = Moments.of(in_double).scaled(factor.double())
        return {
            "displacement": moments.mean.float(),
            "std": moments.std.float(),
            "std_epistemic": moments.std_epistemic.float(),
            "std_aleatoric": moments.std_aleatoric.float(),
        }


@checked_arguments
def export(
    run: str | Path,
    out: str | Path,
    *,
    format: Format,
    passes: int | None = None,
    seed: int | None = None,
    directions: int | None = None,
    parameters: Mapping[str, float] | None = None,
) -> float:
    """Write the network of a run to a file, and compare the file's results with the network's.

    Threads export in turn. No other thread may use PyTorch meanwhile, since its exporter changes
    the operations of all threads; another process may.

    Parameters
    ----------
    run : str or Path
        Run folder, or the name of a network that comes with the package.
    out : str or Path
        File to write; it ends in .onnx or .pt2, as its format.
    format : {"onnx", "pt2"}
        ONNX, or a program of `torch.export`.
    passes : int, optional
        Number of passes T. The weights of the passes become constants of the file, and its result
        equals that of `Surrogate.predict_distribution`. None for the mean weights.
    seed : int, optional
        Seed of the passes; the default is 0.
    directions : int, optional
        Number of directions towards the equilibrium that the file takes after the prediction. It
        then has the length of the last one in m as ``estimate``, (samples,), and no standard
        deviations.
    parameters : mapping of str to float, optional
        Those of the body's shape, of a family of shapes.

    Returns
    -------
    float
        Largest difference under random loads, relative to the largest value of the field.

    Raises
    ------
    InputError
        If there is no finished run, the file's name or the passes are wrong, there are too many
        passes for an ONNX file, a package is missing, or a file cannot hold the directions of this
        body.
    WorkError
        If the format cannot express the network, or the file's result differs from the network's.
        The file is then removed.
    """
    path = Path(out)
    require_suffix(path, (f".{format}",))
    require_writable(path)
    require_packages(format)
    if seed is not None and passes is None:
        raise InputError(f"seed {seed}: expected beside passes", "seed")
    with _EXPORTS:
        model = load(run).of_shape(parameters) if parameters else load(run)
        return export_network(model, format, path, passes, seed, directions)


def export_network(
    surrogate: Surrogate,
    kind: Format,
    path: Path,
    passes: int | None = None,
    seed: int | None = None,
    directions: int | None = None,
    response_given: bool = False,
) -> float:
    """Write a network as `export` does; the surrogate cannot be used afterwards.

    Parameters
    ----------
    response_given : bool
        The linear response to the forces, ``response`` in m and double precision, is a second input
        of the file, which is then small for large bodies too. Networks without linear response
        have one input.
    """
    response_given = response_given and surrogate.network.linear is not None
    if passes is not None:
        surrogate.require_stochastic(passes=passes)
        require_passes(passes, seed or 0)
        drawn = sum(p.nbytes for p in surrogate.network.parameters()) if passes > 1 else 0
        require_memory(passes * drawn, f"passes {passes}: the file", "passes")
        surrogate.predictor.passes.fix(seed or 0, range(passes))
    surrogate.network.requires_grad_(False)
    if isinstance(surrogate.network.network, ReducedNetwork):
        surrogate.network.network.equilibrium = None  # a search, which a file cannot hold
    driven = None if directions is None else fixed_directions(surrogate, directions)
    function = NodalFunction(surrogate.predictor.network, passes, driven)

    data, geometry = surrogate.description.data, surrogate.geometry
    most = min(CHECKED_LOADS, data.load_numbers[1])
    family = random_loads("trained", geometry, data.info.force.max_abs, (1, most))

    def random_inputs(samples: int) -> tuple[Tensor, ...]:
        force = torch.from_numpy(family.draw(samples, np.random.default_rng(samples))).float()
        return (force, responses(surrogate, force)) if response_given else (force,)

    checked = [random_inputs(samples) for samples in CHECKED_BATCHES]
    inputs = random_inputs(2)
    names = ("force", "response")[: len(inputs)]
    if not response_given:
        for module in function.modules():
            _make_exportable(module)
    with torch.no_grad(), complete_or_absent(path) as partial:
        try:
            save_function(function, inputs, names, kind, partial)
        except RuntimeError as error:
            reason = first_line(error)
            raise WorkError(f"{path}: {kind} cannot express this network ({reason})") from error
        exported = load_exported(partial)
        difference = max(largest_difference(exported(*i), function(*i)) for i in checked)
        allowed = tolerance(surrogate)
        if not difference <= allowed:  # true for NaN as well
            raise WorkError(
                f"{path}: differs from the network by {difference:.1e}, "
                f"expected {allowed:.0e} at most"
            )
    return difference


def tolerance(surrogate: Surrogate) -> float:
    """Largest difference of a file that is right, relative to the largest value of a field.

    Under loads that move a large body far, the energy of a load series is so flat that rounding
    errors of its terms, in single precision, are amplified a hundredfold.
    """
    response = surrogate.network.linear
    rough = isinstance(response, SeriesResponse) and response.precision == torch.float32
    return ROUGH_TOLERANCE if rough else TOLERANCE


def _make_exportable(module: nn.Module) -> None:
    """Replace the solver of a large body, which a file cannot hold, by an equal one that it can."""
    if not isinstance(module, LinearResponse):
        return
    compliance = module.compliance
    if isinstance(compliance, Compliance) and compliance.is_small:
        compliance.make_dense()
    elif isinstance(compliance, Compliance):
        if compliance.equilibrium.layout.width is None:
            raise InputError(
                f"the stiffness of {len(compliance.dofs)} degrees of freedom is too large for an "
                "exported file, expected a smaller body"
            )
        module.compliance = BlockSolve(compliance.equilibrium)


def fixed_directions(surrogate: Surrogate, count: int) -> FixedDirections:
    """Some directions of a body, with the response of the network if it is a load series."""
    equilibrium, response = surrogate.body.equilibrium, surrogate.network.linear
    require_exportable(equilibrium, count)
    if not isinstance(response, SeriesResponse):  # in double precision
        materials = equilibrium.solid.materials
        response = LinearResponse(equilibrium.geometry, materials, False, torch.float64)
    return FixedDirections(equilibrium, response, count)


def load_exported(path: Path) -> Callable[..., Fields]:
    """Load an exported file as a user does; return a function of forces (samples, n_nodes, d)."""
    if path.suffix == ".pt2":
        return torch.export.load(path).module()
    import onnxruntime

    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]

    def run(*inputs: Tensor) -> Fields:
        fed = {
            i.name: values.numpy() for i, values in zip(session.get_inputs(), inputs, strict=True)
        }
        outputs = session.run(names, fed)
        return {name: torch.from_numpy(o) for name, o in zip(names, outputs, strict=True)}

    return run


def responses(surrogate: Surrogate, force: Tensor) -> Tensor:
    """Return the linear responses in m to forces in N, both (samples, n_nodes, d); in double."""
    linear = surrogate.network.linear
    assert isinstance(linear, LinearResponse)
    return linear.at_nodes(surrogate.predictor.network.on_grid(force)).transpose(1, 2).double()


def largest_difference(found: Fields, expected: Fields) -> float:
    """Return the largest difference of all fields, relative to the field's largest value.

    Standard deviations are not resolved finer than the displacements in single precision.
    """
    if found.keys() != expected.keys():
        return float("inf")
    finest = PRECISION * expected["displacement"].abs().max()
    differences = []
    for name, field in expected.items():
        difference, largest = (found[name] - field).abs().max(), field.abs().max()
        allowed = 0.0 if name == "displacement" else finest
        differences.append((difference - allowed).clamp(min=0) / (largest or 1.0))
    return float(torch.stack(differences).max())


def save_function(
    function: nn.Module, inputs: tuple[Tensor, ...], names: Sequence[str], kind: Format, path: Path
) -> None:
    """Write a function of named inputs, (samples, …) each, for any number of samples.

    Raises
    ------
    RuntimeError
        If the format cannot express it.
    """
    with _EXPORTS, torch.no_grad(), _silence():
        shapes = tuple({0: Dim("samples")} for _ in inputs)
        program = torch.export.export(function, inputs, dynamic_shapes=shapes)
        if kind == "onnx":
            _save_onnx(program, names, list(function(*inputs)), path)
        else:
            _save_pt2(program, path)


def _save_onnx(
    program: ExportedProgram, inputs: Sequence[str], outputs: Sequence[str], path: Path
) -> None:
    size = sum(t.nbytes for t in (*program.state_dict.values(), *program.tensor_constants.values()))
    if size > ONNX_LIMIT:
        raise InputError(
            f"format 'onnx': the weights take {size / 1e9:.1f} GB, such a file holds "
            f"{ONNX_LIMIT / 1e9:.0f} GB; expected fewer passes, or 'pt2'",
            "format",
        )
    converted = torch.onnx.export(
        program,
        input_names=list(inputs),
        output_names=list(outputs),
        dynamic_shapes={name: {0: "samples"} for name in inputs},
        opset_version=ONNX_OPSET,
        external_data=False,
        verbose=False,
    )
    assert converted is not None
    converted.save(path)


def _save_pt2(program: ExportedProgram, path: Path) -> None:
    buffer = io.BytesIO()  # PyTorch's own writer crashes the process if the disk is full
    torch.export.save(program, buffer)
    path.write_bytes(buffer.getbuffer())


def require_packages(kind: Format) -> None:
    """Raise InputError if a package that writes or checks such a file is missing."""
    missing = [name for name in ONNX_PACKAGES if kind == "onnx" and find_spec(name) is None]
    if missing:
        raise InputError(
            f"format 'onnx': needs {', '.join(missing)}, "
            "expected pip install 'solid-surrogate[export]'",
            "format",
        )


@contextmanager
def _silence() -> Iterator[None]:
    """Suppress warnings and log messages of PyTorch's exporters."""
    before = logging.root.manager.disable
    logging.disable(max(logging.WARNING, before))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)
