"""The positions at rest from the recordings of the beam (c3d), for which ezc3d has to be installed.

    python -m experiments.benchmarks.silicone_beam.extract FOLDER

reads the recordings of ``python/realbeam_experiments/Measurement_data`` of the repository
srl-ethz/diffPD_sim2real (names without ``V2_``), and writes ``positions.csv`` beside this file.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

from shared_schema.common import write_text

LET_GO = {  # frame of first motion
    "gravity_a": 71,
    "gravity_b": 63,
    "load52_a": 43,
    "load52_b": 58,
}
HELD = slice(-12, -2)  # frames, from that of first motion
LAST = 60  # frames at rest
HEAD = "recording,marker,X,Y,Z,x,y,z,std"


def main(folder: Path) -> None:
    """Write, in m, mean places of each marker held and at rest, and the noise at rest."""
    read = import_module("ezc3d").c3d
    lines = [HEAD]
    for name, frame in LET_GO.items():
        recording = read(str(folder / f"beam_{name}.c3d"))
        markers = recording["parameters"]["POINT"]["LABELS"]["value"]
        places = recording["data"]["points"][:3].transpose(1, 2, 0)
        for marker, path in zip(markers, places, strict=True):
            held, rest = path[:frame][HELD], path[-LAST:]
            numbers = [*held.mean(axis=0), *rest.mean(axis=0), rest.std(axis=0).mean()]
            label = marker.lower().replace(" - ", " ")
            lines.append(",".join([name, label, *(f"{value:.7f}" for value in numbers)]))
    write_text(Path(__file__).with_name("positions.csv"), "\n".join(lines) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
