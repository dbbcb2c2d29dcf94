"""surrogate touch: from a shape to a page on which one touches it."""

from __future__ import annotations

import argparse
import os
import webbrowser
from pathlib import Path

from shared_schema.common.command_line import Commands, add_command, add_set
from surrogate.command_options import positive, whole

SAMPLES = 500  # of a network


def add_to(commands: Commands) -> None:
    """Add the command's parser."""
    parser = add_command(
        commands,
        "touch",
        "make a page on which one touches the body of a file, such as a closed surface",
        'surrogate touch organ.stl --scale 0.001 --support "z<0.01" --young-modulus 5000',
        'surrogate touch organ.stl --scale 0.001 --support "z<0.01" --young-modulus 5000 --network',
    )
    parser.add_argument(
        "shape",
        type=Path,
        metavar="FILE",
        help="closed surface, segmented image, CAD file, gmsh script or mesh",
    )
    parser.add_argument(
        "--support",
        action="append",
        required=True,
        metavar="WHERE",
        help="where the body is held, in m: 'z<0.01', 'x<0.1,y>0.2', 'sphere:X,Y,Z:R', a patch of "
        "the surface 'patch:X,Y,Z:R', or 'plane:X,Y,Z:NX,NY,NZ'; repeatable",
    )
    parser.add_argument(
        "--young-modulus", type=positive, required=True, metavar="PA", help="in Pa, at rest"
    )
    parser.add_argument(
        "--poisson-ratio",
        type=float,
        default=0.4,
        metavar="NU",
        help="(default 0.4); above it elements are incompressible, unless --set element=linear",
    )
    parser.add_argument(
        "--scale", type=positive, default=1.0, metavar="M", help="length of the file's unit in m"
    )
    parser.add_argument(
        "--size", type=positive, metavar="H", help="size of the cells, in the file's unit"
    )
    parser.add_argument(
        "--repair", action="store_true", help="make one closed surface of the triangles first"
    )
    parser.add_argument(
        "--zone",
        action="append",
        default=[],
        dest="zones",
        metavar="NAME=FILE:E",
        help="part of another Young's modulus in Pa, inside of another closed surface; repeatable",
    )
    add_set(parser, "the case", "mesh.labels={liver: 1}")
    parser.add_argument(
        "--network",
        type=whole,
        nargs="?",
        const=SAMPLES,
        metavar="N",
        help="go on to a network that predicts in about 1 ms, from N samples (default "
        f"{SAMPLES}); resumes by itself",
    )
    parser.add_argument(
        "--workers",
        type=whole,
        default=os.cpu_count() or 1,
        metavar="W",
        help="processes that make the samples (default: one a core)",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder (default: the shape's name)"
    )
    parser.add_argument(
        "--no-browser", action="store_true", help="write the page, and do not open it"
    )
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Make the page, say where it is, and open it."""
    import surrogate
    from surrogate.page.shape import PageLimitError

    try:
        page = surrogate.page_of_shape(
            options.shape,
            options.support,
            options.young_modulus,
            poisson_ratio=options.poisson_ratio,
            scale=options.scale,
            size=options.size,
            repair=options.repair,
            zones=options.zones,
            changes=options.changes,
            out=options.out,
        )
    except PageLimitError as error:
        if not options.network:
            raise
        folder = error.folder
    else:
        folder = page.parent
        print(page)
        print(f"{folder / 'series'}: run folder of its load series")
        if not options.no_browser:
            webbrowser.open(page.resolve().as_uri())
    if options.network:
        given = {"samples": options.network, "workers": options.workers}
        made = surrogate.network_of_body(folder / "body", folder, **given)
        print(f"{made}: run folder; its page is {folder / 'network.html'}")
