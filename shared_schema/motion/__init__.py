"""Motion: the scheme of time steps, the settings of a case, loads over time, and masses."""

from shared_schema.motion.histories import Band, History, LoadOverTime, Ramp, read_history
from shared_schema.motion.mass import densities_of_cells, mass_blocks, mass_matrix
from shared_schema.motion.scheme import Begun, Scheme
from shared_schema.motion.settings import Damping, TimeSettings

__all__ = [
    "Band",
    "Begun",
    "Damping",
    "History",
    "LoadOverTime",
    "Ramp",
    "Scheme",
    "TimeSettings",
    "densities_of_cells",
    "mass_blocks",
    "mass_matrix",
    "read_history",
]
