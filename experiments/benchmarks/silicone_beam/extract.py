"""What the recordings of the beam (c3d) tell, for which ezc3d has to be installed.

    python -m experiments.benchmarks.silicone_beam.extract FOLDER

reads the recordings of ``python/realbeam_experiments/Measurement_data`` of the repository
srl-ethz/diffPD_sim2real (names without ``V2_``), and writes two tables beside this file: the
positions at rest, ``positions.csv``, and the deflection over time, ``swings.csv``.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import numpy as np

from experiments.benchmarks.silicone_beam import recordings
from shared_schema.common import write_text

LET_GO = {  # frame of first motion
    "gravity_a": 71,
    "gravity_b": 63,
    "load52_a": 43,
    "load52_b": 58,
}
HELD = slice(-12, -2)  # frames, from that of first motion
LAST = 60  # frames at rest
SWING = 250  # frames, from that before first motion
HEAD = "recording,marker,X,Y,Z,x,y,z,std"


def main(folder: Path) -> None:
    """Write, in m, mean places of each marker held and at rest, noise at rest, and the swing."""
    read = import_module("ezc3d").c3d
    lines, swings = [HEAD], []
    for name, frame in LET_GO.items():
        recording = read(str(folder / f"beam_{name}.c3d"))
        markers = recording["parameters"]["POINT"]["LABELS"]["value"]
        places = recording["data"]["points"][:3].transpose(1, 2, 0)
        for marker, path in zip(markers, places, strict=True):
            held, rest = path[:frame][HELD], path[-LAST:]
            numbers = [*held.mean(axis=0), *rest.mean(axis=0), rest.std(axis=0).mean()]
            label = marker.lower().replace(" - ", " ")
            lines.append(",".join([name, label, *(f"{value:.7f}" for value in numbers)]))
        held = places[:, :frame][:, HELD].mean(axis=1)
        swing = places[:, frame - 1 : frame - 1 + SWING].swapaxes(0, 1)
        swings.append([recordings.moved(held, now)[:, 2].mean() for now in swing])
    write_text(Path(__file__).with_name("positions.csv"), "\n".join(lines) + "\n")
    table = [",".join(LET_GO), *(",".join(f"{z:.6f}" for z in row) for row in np.transpose(swings))]
    write_text(recordings.SWINGS, "\n".join(table) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
