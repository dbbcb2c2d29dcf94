"""Times of pages in Chromium without a graphics processor: first frame, press, drag, estimate.

    python -m experiments benchmark page [--runs RUN …]

writes its record and its page. Without --runs, it measures
the pages of the trained networks of the package.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser

from experiments.benchmarks.benchmark import Results
from experiments.framework.report import table_of
from experiments.framework.timing import timed
from shared_schema.common import Parser
from surrogate import load, shelved, write_page
from tests.surrogate.page.browser import OpenPage, chromium

WIDTH, HEIGHT = 1280, 800
FRAME = 16  # ms between two pointer events, as of a screen with 60 Hz
RADIUS = 90  # pixels, of the pointer's way around the pressed node
DESCRIPTION = """\
Pages of `surrogate page` in headless Chromium {chromium}, {width} × {height} pixels, without a
graphics processor: SwiftShader draws on the same cores. Times in ms.

- *first frame*, *ready*: from the start of navigation to the body at rest, to the network
- *press*: from the first press on a node to its first frame
- *frame*: from the delivery of a pointer event to its drawn frame, read back from the canvas:
  median (10 to 90 % quantile) over {moves} events {apart} ms apart; *drawing*: a frame without a
  prediction
- *estimate*: from the end of a drag to the estimated error
"""
TIMES = (  # of one call, in ms: predictions alone, and frames alone
    "async (count) => { const times = []; for (let i = 0; i < count; i++) {"
    " const began = performance.now(); %s; times.push(performance.now() - began); }"
    " return times; }"
)


def quantiles(times: Sequence[float]) -> list[float]:
    """10 %, 50 % and 90 % quantile."""
    return [round(float(q), 2) for q in np.quantile(times, [0.1, 0.5, 0.9])]


def drags(page: OpenPage, node: int, moves: int) -> Results:
    """Press on a node and drag it around; return times in ms."""
    x, y = page.pixel(node)
    mouse = page.page.mouse
    page.page.evaluate("surrogatePage.measure = true")
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + 10, y)
    pressed = 1e3 * timed(page.settle)[1]
    page.page.evaluate("surrogatePage.times.length = 0")
    for angle in np.linspace(0, 4 * np.pi, moves):
        mouse.move(x + RADIUS * np.cos(angle), y + RADIUS * np.sin(angle))
        page.page.wait_for_timeout(FRAME)
    mouse.up()
    page.settle()
    delivered, since = zip(*page.page.evaluate("surrogatePage.times"), strict=True)
    estimated: float | None = None
    if "error" in page.page.evaluate("surrogatePage.state.choices"):
        estimated = 1e3 * timed(page.certificate)[1]
    drawing = page.page.evaluate(
        TIMES % "surrogatePage.scene.show(); surrogatePage.scene.finish()", 30
    )
    return {
        "press_ms": round(pressed, 1),
        "frame_ms": quantiles(delivered),
        "since_event_ms": quantiles(since),
        "drawing_ms": quantiles(drawing),
        "frames": len(delivered),
        **({} if estimated is None else {"estimate_ms": round(estimated, 1)}),
    }


def measure_run(browser: Browser, run: str, moves: int, openings: int) -> Results:
    """Measure the page of one run."""
    model = load(run)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        written = write_page(run, path)
        found = measure_page(browser, path, model.geometry.tip, moves, openings)
    return {
        "run": Path(run).name,
        "network": model.description.run.architecture,
        "nodes": len(model.geometry.coordinates),
        "dimension": model.geometry.dimension,
        "passes": None if written.passes is None else written.passes * model.network.members,
        "megabytes": round(written.size / 1e6, 1),
        **found,
    }


def measure_page(browser: Browser, path: Path, node: int, moves: int, openings: int) -> Results:
    """Open a page several times, and drag a node, or what can be touched of a large body."""
    marks: dict[str, list[float]] = {}
    for opening in range(openings):
        page = OpenPage(browser, path, WIDTH, HEIGHT)
        for name, begins in page.page.evaluate(
            "performance.getEntriesByType('mark').map((m) => [m.name, m.startTime])"
        ):
            marks.setdefault(name, []).append(begins)
        if opening == openings - 1:
            places = page.page.evaluate("surrogatePage.state.content.places")
            found = drags(page, places[-1] if places else node, moves)
            if places:
                found["places"] = len(places)
        page.close()
    return {
        "first_frame_ms": round(float(np.median(marks["first frame"])), 0),
        "ready_ms": round(float(np.median(marks["ready"])), 0),
        **found,
    }


def measure(options: argparse.Namespace) -> Results:
    """Results for all runs."""
    found: list[Results] = []
    with chromium() as browser:
        version = browser.version
        for run in options.runs or shelved():
            found.append(measure_run(browser, run, options.moves, options.openings))
            print(found[-1], file=sys.stderr)
    return {"chromium": version, "moves": options.moves, "pages": found}


def page(results: Results) -> str:
    """Make the page."""
    rows = table_of(
        results["pages"],
        {
            "page": lambda r: (
                f"`{r['run']}`: {r['network']}" + (f", {r['passes']} passes" if r["passes"] else "")
            ),
            "nodes": "{nodes}",
            "MB": "{megabytes:.1f}",
            "first frame": "{first_frame_ms:.0f}",
            "ready": "{ready_ms:.0f}",
            "press": "{press_ms:.0f}",
            "frame": "{frame_ms[1]:.3g} ({frame_ms[0]:.3g} to {frame_ms[2]:.3g})",
            "drawing": "{drawing_ms[1]:.3g} ({drawing_ms[0]:.3g} to {drawing_ms[2]:.3g})",
            "estimate": lambda r: f"{r['estimate_ms']:.0f}" if "estimate_ms" in r else "–",
        },
    )
    description = DESCRIPTION.format(
        chromium=results["chromium"],
        width=WIDTH,
        height=HEIGHT,
        moves=results["moves"],
        apart=FRAME,
    )
    return f"{description}\n{rows}"


def arguments(parser: Parser) -> None:
    """Add the options."""
    parser.add_argument("--runs", nargs="+", metavar="RUN", help="runs to measure")
    parser.add_argument("--moves", type=int, default=240, help="pointer events of a drag")
    parser.add_argument("--openings", type=int, default=5, help="times that a page is opened")


TITLE = "Times of pages to drag loads on"
