"""Free memory is the smallest of what machine, container and process have left."""

from __future__ import annotations

import platform
import subprocess
import sys
from pathlib import Path

import pytest

from shared_schema.common import machine
from shared_schema.common.errors import InputError
from shared_schema.common.machine import GIB, available_memory, processor, require_memory


def test_the_machine_and_its_containers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """8 GiB of the machine; 2 of 3 GiB in an outer group, 1 of which is cache: 2 GiB."""
    (tmp_path / "self").mkdir()
    (tmp_path / "meminfo").write_text(f"MemTotal: 9 kB\nMemAvailable: {8 * 2**20} kB\n")
    monkeypatch.setattr(machine, "PROC", tmp_path)
    monkeypatch.setattr(machine, "CGROUPS", tmp_path)
    assert available_memory() == 8 * GIB
    (tmp_path / "self" / "cgroup").write_text("0::/outer/inner\n")
    inner = tmp_path / "outer" / "inner"
    inner.mkdir(parents=True)
    for folder, limit in ((inner, "max"), (inner.parent, str(3 * GIB))):
        (folder / "memory.max").write_text(f"{limit}\n")
        (folder / "memory.current").write_text(f"{2 * GIB}\n")
        (folder / "memory.stat").write_text(f"anon 5\ninactive_file {GIB}\n")
    assert available_memory() == 2 * GIB


def test_too_much_is_refused_with_the_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "available_memory", lambda: 1.5 * GIB)
    require_memory(1.4 * GIB, "mesh.elements")
    said = r"mesh\.elements: needs 1\.6 GiB of memory at least, expected at most the 1\.5 GiB"
    with pytest.raises(InputError, match=said):
        require_memory(1.6 * GIB, "mesh.elements")


def test_the_limit_of_the_process() -> None:
    code = """
import resource
from shared_schema.common.machine import available_memory
resource.setrlimit(resource.RLIMIT_AS, (2**31, 2**31))
assert 0.5 * 2**30 < available_memory() < 2**31
"""
    subprocess.run([sys.executable, "-c", code], check=True)


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
    monkeypatch.setattr(machine, "PROCESSORS", path)
    assert processor() == name
