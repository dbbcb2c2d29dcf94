"""What the units of a case and a dataset are, and when another set may stand for them."""

from __future__ import annotations

GUIDANCE = """\
Units are SI: m, N, Pa, s. In two dimensions the body is 1 m thick, so forces are per metre of
thickness. Any other consistent set of units works too, since nothing is converted: a mesh in mm
needs stresses in MPa; forces are then in N, displacements and errors in mm, `--tolerance` is in mm,
and a plane body is 1 mm thick. All labels in files, figures and messages still say m and Pa. Use
the same set for a case and all its networks. A mesh in mm with stresses in Pa describes a body that
is a thousand times too large: its displacements are far too small.
"""
