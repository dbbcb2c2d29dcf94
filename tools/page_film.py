"""A film of a page in motion for the documentation: pull, let go, push, and the estimated error.

    .venv-surrogate/bin/python -m tools.page_film

writes `docs/figures/page-motion.webp`, of the 2D beam. Steps are taken by hand, three of them a
frame, so that the film shows the page in real time.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import surrogate
from tests.surrogate.page.browser import OpenPage, chromium

OUT = Path(__file__).parents[1] / "docs" / "figures" / "page-motion.webp"
RUN, DENSITY = "beam2d_any", 0.1  # kg/m³
SIZE, SHOWN, QUALITY = (1100, 620), (880, 496), 50
RATE, STEPS = 20, 3  # frames a second, steps of 1/60 s
POINTER = """() => {
    const dot = document.body.appendChild(document.createElement("div"));
    dot.style = "position:fixed;width:16px;height:16px;border-radius:8px;margin:-8px;"
        + "background:#d9480f99;pointer-events:none;left:-20px";
    addEventListener("pointermove", ({ clientX: x, clientY: y }) =>
        Object.assign(dot.style, { left: `${x}px`, top: `${y}px` }), true);
}"""


def frames(page: OpenPage) -> Iterator[Image.Image]:
    """Pull the tip and let go, push with a sphere, show the error of the steps."""
    model, mouse = surrogate.load(RUN), page.page.mouse

    def shown(count: int) -> Iterator[Image.Image]:
        for _ in range(count):
            page.page.evaluate("surrogatePage.clock.rest()")
            page.take(STEPS)
            page.settle()
            yield Image.open(io.BytesIO(page.page.screenshot())).convert("RGB").resize(SHOWN)

    def dragged(x: float, y: float, way: np.ndarray) -> Iterator[Image.Image]:
        mouse.move(x, y)
        mouse.down()
        for right, up in way:
            mouse.move(x + right, y - up)
            yield from shown(1)
        mouse.up()

    x, y = page.pixel(model.geometry.tip)
    there = np.sin(np.linspace(0, np.pi / 2, 26))[:, None] * [-15, -130]
    yield from dragged(x, y, there)
    yield from shown(54)
    page.page.check("input[value=push]")
    middle = int(np.abs(model.geometry.coordinates - [3.2, 1]).sum(axis=1).argmin())
    x, y = page.pixel(middle)
    down = np.linspace(0, 1, 30)[:, None] * [0, -110]
    away = np.linspace(1, 0, 8)[:, None] * [0, -150] + [0, 40]
    yield from dragged(x, y, np.concatenate([down, away]))
    page.page.click("#take-away")
    page.page.check("input[value=error]")
    page.page.locator("#damping input[type=number]").fill("0.1")
    yield from shown(82)


def main() -> None:
    """Write the film."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        path = Path(folder) / "page.html"
        surrogate.write_page(RUN, path, density=DENSITY)
        page = OpenPage(browser, path, *SIZE)
        page.page.evaluate(POINTER)
        page.begin_motion()
        first, *others = frames(page)
        page.close()
    settings: Any = {"quality": QUALITY, "method": 4, "duration": 1000 // RATE, "loop": 0}
    first.save(OUT, save_all=True, append_images=others, **settings)
    print(f"{OUT}: {len(others) + 1} frames, {OUT.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
