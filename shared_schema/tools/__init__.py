"""Rigid tools that touch a body: their signed distance, positive outside of the tool.

Lengths are in m; in the plane a sphere is a disc.

================  ===========================================================
`tool`            what all tools tell: distance, normal, curvature
`shapes`          planes, spheres and capsules in closed form
`closed_surface`  any closed surface of triangles, at a pose
`displaced`       any tool, elsewhere
`given_tool`      tools as commands take them
`contact`         what a tool does to a body
`meshio_reader`   files that meshio reads
================  ===========================================================
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from shared_schema.tools.closed_surface import Mesh
    from shared_schema.tools.contact import Contact, contact_line
    from shared_schema.tools.displaced import Displaced
    from shared_schema.tools.given_tool import parse_tool
    from shared_schema.tools.shapes import Capsule, Plane, Sphere
    from shared_schema.tools.tool import Tool, require_outside

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
