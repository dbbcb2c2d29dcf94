"""Elements with points between the nodes: holding and identifying refuse them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

import surrogate
from shared_schema.common.errors import InputError
from surrogate.data.geometry import PREFIX
from surrogate.identification import Markers, identify
from surrogate.inference.loading import make_surrogate
from surrogate.inference.surrogate import Surrogate
from surrogate.runs.folder import RunFolder
from surrogate.runs.shelf import find_run

MARKERS = Markers(np.array([[4.0, 1.0]]), np.array([[4.0, 0.9]]))
ASKED: dict[str, tuple[str, Callable[[Surrogate], object]]] = {
    "held": ("held places", lambda model: model.solve(held=["4,1:-,-0.1"])),
    "grip": ("held places", lambda model: surrogate.Grip(model, ["4,1"])),
    "identify": ("identifications", lambda model: identify(model, MARKERS, ["4,1"])),
}


def with_element(element: str) -> Surrogate:
    """The beam of `beam2d_any` with other elements, `incompressible` ones on triangles."""
    folder = RunFolder(find_run("beam2d_any"))
    description, tensors = folder.description(), dict(folder.read_tensors())
    data = description.data
    data = data.model_copy(update={"case": {**data.case, "element": element}})
    if element == "incompressible":
        quads = tensors[f"{PREFIX}cells"]
        halves = [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
        tensors[f"{PREFIX}cells"] = torch.cat(halves)
        data = data.model_copy(update={"cell_type": "triangle"})
    return make_surrogate(tensors, description.model_copy(update={"data": data}))


@pytest.mark.parametrize("element", ["quadratic", "incompressible"])
def test_what_is_for_nodes_alone_is_refused_in_a_line(element: str) -> None:
    model = with_element(element)
    for what, asked in ASKED.values():
        with pytest.raises(InputError) as refused:
            asked(model)
        message = str(refused.value)
        assert message.startswith(f"key 'element' of the run's case = '{element}': {what} are for ")
        assert message.endswith(("; `datagen solve` has them for all", "linear' has them"))
        assert "\n" not in message
