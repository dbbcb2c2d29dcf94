"""Pictures of pages for the documentation, at twice their size and smoothed down.

    .venv-surrogate/bin/python -m tools.page_pictures RUN NAME [--drag RIGHT UP [--push X,Y[,Z]]]
        [--given ACTUATOR=VALUE]

writes `docs/figures/page-NAME.jpg` and, of a narrow screen, `docs/figures/page-NAME-narrow.jpg`:
of the tip under a force, of a sphere that is put on the body at a place, and dragged, or of a body
whose actuators have some values. RUN may be the folder of a body.
"""

from __future__ import annotations

import argparse
import io
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Browser

from surrogate import write_page
from surrogate.page.page import surrogate_of
from tests.surrogate.page.browser import OpenPage, chromium

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
SIZES = {"": (1280, 800), "-narrow": (360, 740)}
SCALE, QUALITY = 2, 82
STEPS = 15  # of a drag


def take(
    browser: Browser,
    path: Path,
    size: tuple[int, int],
    gesture: str,
    node: int,
    drag: tuple[float, float] | None,
    given: dict[str, str],
) -> Image.Image:
    """Take a picture of a page after a drag, in parts of its width, and with actuators."""
    page = OpenPage(browser, path, *size, scale=SCALE)
    page.page.check(f"input[value={gesture}]")
    for name, value in given.items():
        label = page.page.locator("#actuators label").filter(has_text=name)
        label.locator("input[type=number]").fill(value)
        page.settle()
    if drag is not None:
        right, up = (part * size[0] for part in drag)
        page.drag(node, right, up, STEPS)
    page.certificate()
    page.settle()
    picture = Image.open(io.BytesIO(page.page.screenshot()))
    page.close()
    return picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)


def main() -> None:
    """Write both pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("run", type=Path, metavar="RUN")
    parser.add_argument("name", metavar="NAME")
    parser.add_argument("--drag", type=float, nargs=2, metavar=("RIGHT", "UP"))
    parser.add_argument("--push", metavar="X,Y[,Z]")
    parser.add_argument("--given", action="append", default=[], metavar="ACTUATOR=VALUE")
    options = parser.parse_args()
    given = dict(text.split("=") for text in options.given)
    geometry = surrogate_of(options.run).geometry
    gesture, node = "force", geometry.tip
    if options.push:
        place = [float(part) for part in options.push.split(",")]
        node = int(np.linalg.norm(geometry.coordinates - place, axis=1).argmin())
        gesture = "push"
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        path = Path(folder) / "page.html"
        write_page(options.run, path)
        for suffix, size in SIZES.items():
            picture = take(browser, path, size, gesture, node, options.drag, given)
            picture.save(FIGURES / f"page-{options.name}{suffix}.jpg", quality=QUALITY)


if __name__ == "__main__":
    main()
