"""The step of a wheel's build that bundles the page's script; not imported by the program."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from setuptools.command.build_py import build_py

WEB = Path(__file__).parent / "web"
BUNDLE = Path(__file__).parent / "bundle" / "page.js"
SOURCES = (WEB / "src", WEB / "package-lock.json", WEB / "bundle.mjs")
SCRIPTS = (["npm", "ci"], ["npm", "run", "build"])


class BuildWithPage(build_py):
    """Build of the package with the page's bundle, which npm makes if it is missing or old.

    Without npm the package is built without the page, and says so.
    """

    def run(self) -> None:
        """Bundle, then build; an editable install leaves the bundle to `make setup`."""
        if not self.editable_mode and not is_up_to_date():
            if shutil.which("npm") is None:
                self.warn(f"npm not found: built without the page; expected npm, or {BUNDLE}")
            else:
                for script in SCRIPTS:
                    subprocess.run(script, cwd=WEB, check=True)
        super().run()


def is_up_to_date() -> bool:
    """True if there is a bundle, not older than what it is made of."""
    files = [file for source in SOURCES for file in (source, *source.rglob("*"))]
    newest = max(file.stat().st_mtime for file in files)
    return BUNDLE.is_file() and BUNDLE.stat().st_mtime >= newest
