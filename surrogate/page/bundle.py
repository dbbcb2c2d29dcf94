"""The page's script, style and WebAssembly, which one npm script makes of ``web/``.

A wheel contains the bundle, so that its users need no node. A checkout has it after ``make setup``
or the npm script.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from shared_schema.common.errors import InputError

FOLDER = Path(__file__).parent / "bundle"
COMMAND = "npm ci && npm run build"


@dataclass(frozen=True)
class Bundle:
    """The parts of the page that are the same for all bodies.

    Attributes
    ----------
    script, style : str
        JavaScript with three.js and onnxruntime-web's, and CSS.
    runtime : bytes
        onnxruntime-web's WebAssembly, gzipped.
    """

    script: str
    style: str
    runtime: bytes


def read_bundle(folder: Path = FOLDER) -> Bundle:
    """Read the bundle.

    Raises
    ------
    InputError
        If it is not built yet; the message has the command that builds it.
    """
    paths = [folder / name for name in ("page.js", "page.css", "runtime.wasm.gz")]
    if not all(path.is_file() for path in paths):
        raise InputError(
            f"page: {folder} is not built yet, expected: cd {folder.parent / 'web'} && {COMMAND} "
            "(or make setup)"
        )
    script, style, runtime = paths
    return Bundle(script.read_text("utf-8"), style.read_text("utf-8"), runtime.read_bytes())
