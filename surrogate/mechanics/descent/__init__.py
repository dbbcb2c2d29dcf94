"""Directions that drive a prediction towards the equilibrium, until it is right enough.

====================  ========================================================================
`descent`             the loop: directions, Newton's steps from states in doubt, when to stop
`first_direction`     the first one alone, whose length estimates the error
`directions`          single directions and steps along them, by the method of L-BFGS
`fixed_directions`    a fixed number of directions, for exported files
`aim`                 when a prediction is right enough: a tolerance, a time budget
`driven_body`         the body: out-of-balance forces of single states
`soft_modes`          modes in which the body buckles, and their stiffness at a state
`carried_compliance`  the approximate inverse of the tangent that directions are made with
`turned_compliance`   the same of a body in a time step
====================  ========================================================================
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.mechanics.descent.aim import Aim
    from surrogate.mechanics.descent.descent import Descent, descend
    from surrogate.mechanics.descent.driven_body import DrivenBody

__all__ = ["Aim", "Descent", "DrivenBody", "descend"]
__getattr__, __dir__ = lazy_names(__name__)
