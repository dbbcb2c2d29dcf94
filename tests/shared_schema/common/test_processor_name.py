from __future__ import annotations

import importlib
import platform
from pathlib import Path

import pytest

from shared_schema.common.machine import processor

module = importlib.import_module("shared_schema.common.machine")


@pytest.mark.parametrize(
    ("content", "name"),
    [
        ("processor\t: 0\nmodel name\t: Two: Cores\n\nmodel name\t: Other\n", "Two: Cores"),
        ("processor\t: 0\nCPU implementer\t: 0x41\n", platform.machine()),
        (None, platform.machine()),
    ],
)
def test_processor(
    content: str | None, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "cpuinfo"
    if content is not None:
        path.write_text(content)
    monkeypatch.setattr(module, "PROCESSORS", path)
    assert processor() == name
