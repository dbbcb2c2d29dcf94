"""Rigid tools that touch a body: their signed distance, positive outside of the tool.

Lengths are in m; in the plane a sphere is a disc.

================  ===============================================================
`tool`            planes, spheres and capsules, what they do to a body
`closed_surface`  any closed surface of triangles, at a pose
`given_tool`      tools as commands take them
================  ===============================================================
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from shared_schema.tools.closed_surface import Mesh
    from shared_schema.tools.given_tool import parse_tool
    from shared_schema.tools.tool import (
        Capsule,
        Contact,
        Displaced,
        Plane,
        Sphere,
        Tool,
        contact_line,
        require_outside,
    )

__all__ = [
    "Capsule",
    "Contact",
    "Displaced",
    "Mesh",
    "Plane",
    "Sphere",
    "Tool",
    "contact_line",
    "parse_tool",
    "require_outside",
]
__getattr__, __dir__ = lazy_names(__name__)
