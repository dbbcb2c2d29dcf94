"""Use of a trained network: load it, predict, certify and correct one load, export it.

=====================  ========================================================================
`loading`              a network from a run folder, or from the package
`surrogate`            a body and its predictor: `Surrogate`
`solving`              what its `solve` does with a load
`sought_forces`        forces of held places and of a tool
`prediction`           displacements under loads, by a network or by the series of the body
`solution`             what `solve` returns
`training_range`       warnings about forces unlike those of the training
`calibration`          intervals and bounds of a run, on samples it has not seen
`touched_region`       columns of the compliance at the nodes that tools reach
`modal_cubature`       the least energy in the modes of a reduced network
`export`               a file for other programs: ONNX or ``.pt2``
=====================  ========================================================================
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.learning.inference.calibration import drawn_loads, fit_fast_certificate
    from surrogate.learning.inference.export import NodalFunction, fixed_directions
    from surrogate.learning.inference.modal_cubature import balance
    from surrogate.learning.inference.surrogate import Surrogate

__all__ = [
    "NodalFunction",
    "Surrogate",
    "balance",
    "drawn_loads",
    "fit_fast_certificate",
    "fixed_directions",
]
__getattr__, __dir__ = lazy_names(__name__)
