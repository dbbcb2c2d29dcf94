"""Script for an environment with pyplaid: read a PLAID dataset, and write its arrays as .npz."""

from __future__ import annotations

import sys

import numpy as np
from plaid.storage import init_from_disk

folder, out = sys.argv[1:]
datasets, converters = init_from_disk(folder)
arrays: dict[str, np.ndarray] = {}
for split, dataset in datasets.items():
    samples = [converters[split].to_plaid(dataset, row) for row in range(len(dataset))]
    place = {"zone": "Zone", "base": samples[0].get_base_names()[0]}
    for field in samples[0].get_field_names():
        values = [sample.get_field(field, **place) for sample in samples]
        arrays[f"{split}/{field}"] = np.array(values)
    arrays[f"{split}/number"] = np.array([s.get_global("sample_number") for s in samples])
    arrays[f"{split}/coordinates"] = np.array([s.get_nodes(**place) for s in samples])
    for kind, cells in samples[0].get_elements(**place).items():
        arrays[f"{split}/{kind}"] = cells
    for tag, nodes in samples[0].get_nodal_tags(**place).items():
        arrays[f"{split}/{tag}"] = nodes
np.savez(out, allow_pickle=False, **arrays)
