"""What the lists of the commands say about a YAML file."""

from __future__ import annotations

from pathlib import Path

import pytest

from shared_schema.common.command_line import laid_out
from shared_schema.common.configuration import one_line, shipped_files


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("# A beam.\nname: a\n", "A beam"),
        ("# A beam (Smith et al. 2022, Fig. 3) with\n# holes. In m.\nname: a", "A beam with holes"),
        ("# Any load: more of it\n# a: b\n", "Any load"),
        ("# A beam; of 3.5 m.", "A beam"),
        ("# No end\nname: a # not this", "No end"),
        ("name: a\n# later\n", ""),
    ],
)
def test_line(text: str, expected: str) -> None:
    assert one_line(text) == expected


def test_files_are_sorted_by_name(tmp_path: Path) -> None:
    for name in ("b", "a"):
        (tmp_path / f"{name}.yaml").write_text(f"# Is {name}.\nname: {name}\n")
    assert list(shipped_files(tmp_path)) == [
        ("a", {"name": "a"}, "Is a"),
        ("b", {"name": "b"}, "Is b"),
    ]


def test_columns_are_aligned() -> None:
    assert laid_out([("a", "bb"), ("ccc", "")]) == "a    bb\nccc"
