"""The bridge to OpenIGTLink, asked as 3D Slicer would."""

from __future__ import annotations

import socket
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyigtl
import pytest
from numpy.typing import NDArray

import surrogate
from shared_schema.tools import Sphere

SCRIPT = Path(__file__).parents[2] / "docs" / "how-to" / "slicer_bridge.py"
WAIT, HEADER, COUNTS = 60, 58, 40  # s, bytes of a message's header, bytes of numbers of cells
RUN, PLACE, RADIUS = "beam3d_any_reduced", (3.0, 0.5, 1.2), 0.3


def sent(connection: socket.socket, place: tuple[float, ...]) -> None:
    """Send a pose, in m."""
    pose = np.eye(4)
    pose[:3, 3] = 1e3 * np.array(place)
    connection.sendall(pyigtl.TransformMessage(pose, device_name="Tool").pack())


def received(connection: socket.socket) -> tuple[str, bytes]:
    """Read a message: name, and content without extended header."""

    def read(count: int) -> bytes:
        parts = b""
        while len(parts) < count:
            part = connection.recv(count - len(parts))
            assert part, "the bridge has closed the connection"
            parts += part
        return parts

    version, _, name, _, size, _ = struct.unpack(">H12s20sQQQ", read(HEADER))
    body = read(size)
    return name.rstrip(b"\0").decode(), body[12 if version > 1 else 0 :]


def text_of(content: bytes) -> str:
    """Text of a STRING, after encoding and length."""
    (length,) = struct.unpack(">H", content[2:4])
    return content[4 : 4 + length].decode()


def points_of(content: bytes) -> NDArray[np.float64]:
    """Points of POLYDATA, in mm."""
    (count,) = struct.unpack(">I", content[:4])
    points = np.frombuffer(content[COUNTS:], ">f4", 3 * count)
    return points.astype(np.float64).reshape(-1, 3)


@pytest.mark.slow
def test_a_pose_gives_surface_and_force() -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, str(SCRIPT), RUN, str(RADIUS), str(port)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert "listening" in process.stdout.readline()
        model = surrogate.load(RUN)
        frame = surrogate.Touch(model).move(Sphere(PLACE, RADIUS))
        with socket.create_connection(("127.0.0.1", port), timeout=WAIT) as connection:
            sent(connection, PLACE)
            (body, points), (force, text) = received(connection), received(connection)
            assert (body, force) == ("Body", "Force")
            deformed = 1e3 * (model.geometry.coordinates + frame.displacement)
            np.testing.assert_allclose(points_of(points), deformed, atol=1e-2)
            found = [float(value) for value in text_of(text).split()]
            np.testing.assert_allclose(found, frame.reaction, atol=1e-5)
            sent(connection, (0.0, 0.5, 1.2))  # in the support
            name, text = received(connection)
            assert name == "Problem"
            assert "held" in text_of(text)
    finally:
        process.kill()
        process.wait()
