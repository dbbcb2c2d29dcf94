"""What the units of a case and a dataset are, and when another set may stand for them."""

from __future__ import annotations

GUIDANCE = """\
Units are SI: m, N, Pa, s. In two dimensions the body is 1 m thick, so a force is one per metre of
thickness. Every equation is the same in any consistent set, and nothing is converted: a mesh drawn
in mm may stay so if stresses are in MPa; forces are then in N, displacements and errors in mm, and
a plane body is 1 mm thick. All labels (files, figures, messages) go on saying m and Pa, and limits
such as `--tolerance` are in mm. Take one set for a case and all its networks. A mesh in mm with
stresses in Pa is a body a thousand times too large: its displacements are too small by far.
"""
