"""Identification of bodies from markers: forces, their place, stiffness and the whole field.

======================  ============================================================================
`identification`        what users call, and its result
`markers`               markers at rest and seen, and where they are in the mesh
`unknowns`              sought forces and Young's modulus
`responses`             fields of the unknowns and their derivatives by predictions
`tool_response`         the same by the place of a tool
`equilibrium_response`  the same in equilibrium, also of zones whose moduli are sought
`least_squares`         robust nonlinear fits with their covariance, and the error of the model
`misfit`                whether what a fit leaves is noise
`place`                 the node that a force acts on, or around which it is spread
`candidates`            states that fit, and the probabilities of the nodes of a force
`search`                fits of one place or many, then without the error of the surrogate
======================  ============================================================================
"""

from surrogate.mechanics.identification.identification import Identification, identify
from surrogate.mechanics.identification.markers import Markers, read_markers

__all__ = ["Identification", "Markers", "identify", "read_markers"]
