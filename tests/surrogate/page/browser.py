"""A page in Debian's Chromium: mouse, keys, and what the page says."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Browser, Download, Page, ViewportSize, sync_playwright

Array = NDArray[np.float64]
READY = """new Promise((resolve) => {
    const ask = () => window.surrogatePage ? resolve() : setTimeout(ask, 10);
    ask();
}).then(() => surrogatePage.ready)"""
CERTIFIED = """new Promise((resolve) => {
    const ask = () => surrogatePage.state.certificate ? resolve() : setTimeout(ask, 10);
    ask();
})"""
TAKE = """async (count) => {
    const { clock, state } = surrogatePage;
    const frames = [];
    for (let n = 0; n < count; n++) {
        const before = state.motion.time;
        clock.take();
        while (state.motion.time === before) await new Promise((resolve) => setTimeout(resolve));
        frames.push(Array.from(state.displacement));
    }
    return frames;
}"""
ARGUMENTS = ["--enable-unsafe-swiftshader"]  # WebGL without a graphics processor
READBACK = "GPU stall due to ReadPixels"  # a driver's remark on saved and measured pictures


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start the system's browser, without a graphics processor."""
    path = shutil.which("chromium")
    assert path is not None, "chromium is not installed; expected apt-get install chromium"
    sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=[*ARGUMENTS, *sandbox])
        yield browser
        browser.close()


class OpenPage:
    """A page that is ready for loads.

    Attributes
    ----------
    requests, messages : list of str
        Addresses that the page has asked for, and lines of the console, since it was opened.
    """

    def __init__(
        self,
        browser: Browser,
        path: Path,
        width: int = 1100,
        height: int = 700,
        scale: float = 1,
    ) -> None:
        viewport: ViewportSize = {"width": width, "height": height}
        self.page: Page = browser.new_page(viewport=viewport, device_scale_factor=scale)
        self.requests: list[str] = []
        self.messages: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda message: self.say(message.text))
        self.page.on("pageerror", lambda error: self.messages.append(str(error)))
        self.address = path.resolve().as_uri()
        self.page.goto(self.address)
        self.page.evaluate(READY)

    def say(self, text: str) -> None:
        """Keep a line of the console."""
        if READBACK not in text:
            self.messages.append(text)

    def close(self) -> None:
        """Close the page; it has been silent, and has asked for nothing but itself."""
        self.page.close()
        own = (self.address, f"blob:{self.address}", "blob:null/", "data:")
        assert [url for url in self.requests if not url.startswith(own)] == []
        assert self.messages == []

    def pixel(self, node: int) -> tuple[float, float]:
        """Place of a node in the window."""
        return self.pixel_of(self.page.evaluate(f"surrogatePage.scene.body.at({node}).toArray()"))

    def pixel_of(self, x: Sequence[float] | Array) -> tuple[float, float]:
        """Place of a point in space, in m, in the window."""
        box = self.page.locator("#stage canvas").bounding_box()
        assert box is not None
        code = "(x) => surrogatePage.scene.project(surrogatePage.scene.body.at(0).fromArray(x))"
        place = self.page.evaluate(code, [float(value) for value in x])
        return box["x"] + place["x"], box["y"] + place["y"]

    def drag(self, node: int, right: float, up: float, steps: int = 8) -> None:
        """Press on a node, move by some pixels, release; the body follows each step."""
        x, y = self.pixel(node)
        mouse = self.page.mouse
        mouse.move(x, y)
        mouse.down()
        for step in range(1, steps + 1):
            mouse.move(x + right * step / steps, y - up * step / steps)
            self.settle()
        mouse.up()
        self.settle()

    def settle(self) -> None:
        """Wait until body and panel show the present loads."""
        self.page.evaluate("new Promise(requestAnimationFrame)")
        self.page.evaluate("surrogatePage.settled()")

    def begin_motion(self) -> None:
        """Begin a motion whose steps are taken by `take`, after a first one."""
        self.page.evaluate("surrogatePage.clock.isByHand = true")
        self.page.locator("#motion .choices input").check()
        self.settle()

    def take(self, count: int) -> Array:
        """Take time steps; displacements in m at all nodes after each, (count, n_nodes, d)."""
        found = self.page.evaluate(TAKE, count)
        return np.stack([self._nodal(frame) for frame in found])

    def load(self, node: int, *force: float) -> None:
        """Choose a node in the panel, and type in the components of its force."""
        self.page.select_option("#panel select", str(node))
        self.settle()
        card = self.page.locator(".load.selected")
        for place, component in enumerate(force):
            card.locator("input").nth(place).fill(repr(component))
        self.settle()

    @property
    def forces(self) -> Array:
        """Nodal forces in N, (n_nodes, d)."""
        code = "Array.from(surrogatePage.state.loads.nodal())"
        return self._nodal(self.page.evaluate(code))

    def field(self, name: str) -> Array:
        """Output of the network, (n_nodes, d) in m."""
        code = f"Array.from(surrogatePage.state.fields['{name}'])"
        return self._nodal(self.page.evaluate(code))

    def certificate(self) -> tuple[Array, bool]:
        """Estimated error, (n_nodes, d) in m, and whether it is settled."""
        self.page.evaluate(CERTIFIED)
        found = self.page.evaluate(
            "[Array.from(surrogatePage.state.certificate.error),"
            " surrogatePage.state.certificate.settled]"
        )
        return self._nodal(found[0]), bool(found[1])

    def saved(self, kind: str, folder: Path) -> Path:
        """Save a file by its button."""
        with self.page.expect_download() as expected:
            self.page.click(f"#save-{kind}")
        download: Download = expected.value
        path = folder / download.suggested_filename
        download.save_as(path)
        return path

    def text(self, selector: str) -> str:
        """Text of an element."""
        return self.page.locator(selector).inner_text()

    def _nodal(self, values: list[Any]) -> Array:
        dimension: int = self.page.evaluate("surrogatePage.state.content.d")
        return np.array(values, dtype=np.float64).reshape(-1, dimension)
