"""The law of a material as a recording of F, directions of fibres and, of some elements, θ and p.

What runs it, with numbers, derivatives or power series, computes the stress of any material.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from surrogate.mechanics.energy.law import DILATION, Law
from surrogate.mechanics.energy.recording import Recording
from surrogate.mechanics.solids.deformation import Deformation


def recorded_law(law: Law, d: int, projects: bool) -> tuple[Recording, dict[str, Any]]:
    """Record the derivatives of W(F, θ) + p (J - θ) by F and, where there are some, θ and p.

    Parameters
    ----------
    law : Law
    d : int
        Dimension.
    projects : bool
        Whether the element finds θ and p by itself.

    Returns
    -------
    recording : Recording
        Its inputs are F, (d, d), directions (families, d), and θ and p.
    outputs : dict
        ``derivatives``; ``stress``, those by F; ``volume``, J; ``energy``, W; ``slope``, ∂W/∂θ.
    """
    size = d * d + law.families * d
    recording = Recording(size + 2 * projects)
    f: Any = recording.inputs[: d * d].reshape(d, d)
    fibres: Any = recording.inputs[d * d : size].reshape(-1, d)
    dilation, pressure = recording.inputs[size:] if projects else (None, None)
    state: Any = Deformation(f, dilation, fibres)
    energy, *first = law.recording.replayed(state.measures, law.outputs)
    stress = state.stress(first)
    outputs = {
        "volume": state.j,
        "energy": energy,
        "stress": stress,
        "derivatives": stress.ravel(),
    }
    if projects:
        stress = stress + pressure * state.cofactor
        slope = first[DILATION]
        by = [*stress.ravel(), slope - pressure, state.j - dilation]
        outputs |= {"slope": slope, "stress": stress, "derivatives": np.array(by)}
    return recording, outputs
