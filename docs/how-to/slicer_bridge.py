"""Couple a body to 3D Slicer, or any program that talks OpenIGTLink: pose in, force out.

    pip install surrogate pyigtl
    python slicer_bridge.py RUN RADIUS [PORT]

It listens on this machine. A TRANSFORM named "Tool" has the centre of a ball of RADIUS m, in mm.
The replies are POLYDATA "Body", the deformed surface in mm, and STRING "Force", its components on
the body in N, or STRING "Problem".
"""

import sys

import numpy as np
import pyigtl

import surrogate
from shared_schema.common import InputError, WorkError
from shared_schema.tools import Sphere

MM = 1e3  # in a metre


def triangles(facets: np.ndarray) -> np.ndarray:
    """Facets of three or four corners as VTK lists triangles: 3, a, b, c, 3, …"""
    halves = facets[:, [0, 1, 2, 0, 2, 3]] if facets.shape[1] == 4 else facets
    corners = halves.reshape(-1, 3)
    return np.insert(corners, 0, 3, axis=1).ravel()


def main(run: str, radius: float, port: int = 18944) -> None:
    """Answer every pose with a frame."""
    model = surrogate.load(run)
    touch, rest = surrogate.Touch(model), model.geometry.coordinates
    surface = triangles(model.geometry.surface_facets)
    server = pyigtl.OpenIGTLinkServer(port=port)
    print(f"listening on port {port}", flush=True)
    while True:
        pose = server.wait_for_message("Tool", timeout=1)
        if pose is None:
            continue
        centre = tuple(float(value) for value in pose.matrix[:3, 3] / MM)
        try:
            frame = touch.move(Sphere(centre, radius))
        except (InputError, WorkError) as error:
            server.send_message(pyigtl.StringMessage(str(error), device_name="Problem"))
            continue
        points = MM * (rest + frame.displacement)
        force = " ".join(f"{value:.6g}" for value in frame.reaction)
        body = pyigtl.PolyDataMessage(points=points, polygons=surface, device_name="Body")
        server.send_message(body)
        server.send_message(pyigtl.StringMessage(force, device_name="Force"))


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), *map(int, sys.argv[3:]))
