"""The tables of the trained networks and of the recipes that come with the package."""

from __future__ import annotations

from typing import NamedTuple

from shared_schema.common.command_line import laid_out
from shared_schema.common.configuration import shipped_files
from shared_schema.common.errors import InputError
from surrogate.learning.models.kinds import run_config
from surrogate.learning.runs.folder import RunFolder
from surrogate.learning.runs.recipes import SHIPPED, named
from surrogate.learning.runs.shelf import find_run, shelved, size_of
from surrogate.mechanics.body.elements_of_case import require_known_elements
from surrogate.mechanics.body.geometry import PREFIX


class Row(NamedTuple):
    """A network; the fields are the columns."""

    name: str
    network: str
    body: str
    nodes: str
    parameters: str
    error: str
    tip: str
    size: str
    certificates: str


HEAD = Row(*Row._fields)


def row_of(name: str) -> Row:
    """Describe a network: errors are those of its test split, mean ē and median at the tip."""
    run = RunFolder(find_run(name))
    description, evaluation = run.description(), run.read_evaluation()
    config, unit = description.run, description.data.units.length
    coordinates = run.read_tensors()[PREFIX + "coordinates"]
    extent = coordinates.amax(dim=0) - coordinates.amin(dim=0)
    test = evaluation["test"]
    return Row(
        name,
        f"{config.architecture}; {config.likelihood.replace('_', ' ')}",
        " × ".join(f"{length:.3g}" for length in extent.tolist()) + f" {unit}",
        str(len(coordinates)),
        f"{evaluation['trainable_parameters'] / 1e6:.2f} M",
        f"{test['mean_error']:.2e} {unit}",
        f"{test['relative_tip_error_median']:.2%}",
        f"{size_of(run.folder) / 1e6:.1f} MB",
        certificates_of(run),
    )


def certificates_of(run: RunFolder) -> str:
    """Say what `surrogate predict --certify` has for a run: "full, fast", "full" or "none"."""
    data = run.description().data
    try:
        require_known_elements(data.case)
        data.material  # noqa: B018
    except InputError:
        return "none"
    return "full, fast" if run.fast_certificate.is_file() else "full"


def trained_list() -> str:
    """Lay out the table, one line a network."""
    rows = [HEAD, *map(row_of, shelved())]
    return laid_out(rows)


def config_list() -> str:
    """Lay out name, architecture and one line of every recipe."""
    rows = [("configuration", "model", "")]
    for name, content, line in shipped_files(SHIPPED):
        config = run_config(named(content, "CASE", name), name)
        rows.append((name, config.architecture, line))
    return laid_out(rows)
