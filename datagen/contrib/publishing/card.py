"""The card of a published dataset: what it holds, where it is from, how predictions are scored.

The text is that of ``card.md``, filled in from the dataset.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from datagen.contrib.publishing import score
from datagen.output.dataset_info import info
from shared_schema.common.bodies.shape_family import ShapeFamily
from shared_schema.dataset_reader import DatasetReader

TEMPLATE = Path(__file__).with_name("card.md")
SIZES = {1e3: "n<1K", 1e4: "1K<n<10K", 1e5: "10K<n<100K", 1e6: "100K<n<1M"}  # the Hub's names
TOLD = ("mesh", "made by", "digest", "elements", "linear solver", "stability", "largest residual")
SCORES = {  # headings of the baselines, and units
    "mean_error": ("mean error", "length"),
    "relative_mean_error": ("relative mean error", "%"),
    "worst_node_error": ("worst node", "%"),
    "largest_worst_node_error": ("largest worst node", "%"),
    "within_tolerance": (f"within {score.TOLERANCE:.1%}", "%"),
}


def card(
    reader: DatasetReader,
    counts: Mapping[str, int],
    digest: str,
    scores: Mapping[str, Mapping[str, float]],
    license: str,
    owner: str,
) -> str:
    """Write the card of a nodal dataset, with the Hugging Face Hub's metadata at its head.

    Parameters
    ----------
    reader : DatasetReader
    counts : mapping of str to int
        Number of samples of each split.
    digest : str
        SHA-256 of the answers.
    scores : mapping of str to scores
        Of every baseline, by its name.
    license, owner : str
    """
    manifest, family = reader.manifest, ShapeFamily.of_arrays(reader.body)
    nodes, dimension = reader.body["mesh/coordinates"].shape
    length, force = manifest.units["length"], manifest.units["force"]
    at_nodes = f"at every node, ({nodes}, {dimension}), in"
    columns = {
        "number": "number of the sample",
        "force": f"force {at_nodes} {force}",
        "displacement": f"displacement {at_nodes} {length}; NaN in the test split",
    }
    if family is not None:
        ranges = zip(family.names, family.ranges.tolist(), strict=True)
        told = ", ".join(f"{name} ({low:g} to {high:g})" for name, (low, high) in ranges)
        columns["parameters"] = f"of the shape: {told}"
        columns["coordinates"] = f"undeformed position {at_nodes} {length}"
    about = info(reader.folder)
    rows = (
        (
            name,
            *(
                f"{100 * of[key]:.3g} %" if unit == "%" else f"{of[key]:.3g} {length}"
                for key, (_, unit) in SCORES.items()
            ),
        )
        for name, of in scores.items()
    )
    heads = ("method", *(head for head, _ in SCORES.values()))
    title = f"Large deformations: {manifest.name}"
    metadata = {
        "license": license.lower(),
        "pretty_name": title,
        **hub_metadata(
            counts, columns, (nodes, dimension), 0 if family is None else len(family.names)
        ),
    }
    return TEMPLATE.read_text(encoding="utf-8").format(
        metadata=as_yaml(metadata),
        title=title,
        name=manifest.name,
        total=sum(counts.values()),
        of_shapes="" if family is None else " on a shape of its own",
        given="the forces" if family is None else "the forces and the shape",
        reference="" if family is None else ", those of the shape in the middle",
        digest=digest,
        length=length,
        cell_type=reader.cell_type,
        columns=table(("column", "content"), ((f"`{n}`", what) for n, what in columns.items())),
        splits=", ".join(f"{count} samples `{name}`" for name, count in counts.items()),
        seed=manifest.seed,
        nodes=nodes,
        dimension=dimension,
        tolerance=score.TOLERANCE,
        baselines=table(heads, rows) if scores else "None yet.\n",
        provenance=table(("", ""), ((name, about[name]) for name in TOLD if name in about)),
        case=as_yaml(manifest.case),
        license=license,
        owner=owner,
    )


def hub_metadata(
    counts: Mapping[str, int], columns: Iterable[str], shape: Sequence[int], parameters: int
) -> dict[str, Any]:
    """Task, size, files and features, as the Hub reads them."""

    def feature(name: str) -> dict[str, Any]:
        if name == "number":
            return {"dtype": "int64"}
        if name == "parameters":
            return {"list": "float64", "length": parameters}
        return {"dtype": {"array2_d": {"shape": list(shape), "dtype": "float64"}}}

    total = sum(counts.values())
    files = [{"split": split, "path": f"data/{split}.parquet"} for split in counts]
    return {
        "task_categories": ["graph-ml"],
        "tags": ["physics", "mechanics", "hyperelasticity", "surrogate-model"],
        "size_categories": [next((name for most, name in SIZES.items() if total < most), "n>1M")],
        "configs": [{"config_name": "default", "data_files": files}],
        "dataset_info": {"features": [{"name": name, **feature(name)} for name in columns]},
    }


def as_yaml(content: Any) -> str:
    """YAML with keys in their order."""
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown of a table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
