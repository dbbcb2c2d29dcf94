from __future__ import annotations

import json
from pathlib import Path

import pytest

from shared_schema.common.errors import InputError
from surrogate.learning.runs.seal import append_line, read_lines

LINES = [{"epoch": n, "train_loss": 1e-5 / n, "seconds": 0.1 * n} for n in (1, 2, 3)]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    for line in LINES:
        append_line(tmp_path / "metrics.jsonl", line)
    return tmp_path / "metrics.jsonl"


def test_lines_come_back(path: Path) -> None:
    assert read_lines(path, checked=True) == LINES
    assert all(len(json.loads(text)["check"]) == 16 for text in path.read_text().splitlines())
    assert read_lines(path.with_name("none"), checked=True) == []


def test_a_line_cut_short_is_left_out(path: Path) -> None:
    content = path.read_bytes()
    for cut in range(1, len(content.splitlines()[-1])):
        path.write_bytes(content[:-cut])
        assert read_lines(path, checked=True) == LINES[:2]


def test_every_changed_bit_is_found(path: Path) -> None:
    """All bits of the second line; a bit of its end joins two lines, which is found as well."""
    content = path.read_bytes()
    start, end = (content.index(b"\n") + 1, content.rindex(b"\n", 0, -1) + 1)
    for place in range(start, end):
        for bit in range(8):
            changed = bytearray(content)
            changed[place] ^= 1 << bit
            path.write_bytes(changed)
            with pytest.raises(InputError, match=rf"^{path}: line [23] is"):
                read_lines(path, checked=True)


@pytest.mark.parametrize(("lost", "found"), [(0, 2), (1, 3)])
def test_a_missing_line_is_found(path: Path, lost: int, found: int) -> None:
    lines = path.read_text().splitlines(keepends=True)
    del lines[lost]
    path.write_text("".join(lines))
    where = f"line {lost + 1} is of epoch {found}, expected {lost + 1}"
    with pytest.raises(InputError, match=where):
        read_lines(path, checked=True)


@pytest.mark.parametrize(
    "text", ["[]", "3", "null", "{}", '{"epoch": "1"}', '{"epoch": true}', '{"epoch": 1, "a": []}']
)
def test_other_json_is_damage(tmp_path: Path, text: str) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_text(text + "\n")
    for checked in (True, False):
        with pytest.raises(InputError, match="line 1 is damaged"):
            read_lines(path, checked)


def test_lines_of_earlier_versions(tmp_path: Path) -> None:
    path = tmp_path / "metrics.jsonl"
    path.write_text('{"epoch": 1, "seconds": 2.0}\n')
    assert read_lines(path, checked=False) == [{"epoch": 1, "seconds": 2.0}]
    with pytest.raises(InputError, match="line 1 is damaged"):
        read_lines(path, checked=True)


def test_full_disk_names_the_file() -> None:
    with pytest.raises(OSError, match=r"No space left on device: '/dev/full'"):
        append_line(Path("/dev/full"), {"epoch": 1})
