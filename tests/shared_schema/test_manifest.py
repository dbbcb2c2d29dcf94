from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from shared_schema.common.files import write_text
from shared_schema.manifest import digest_of, read_manifest, write_manifest


def test_digest_is_that_of_canonical_json() -> None:
    text = '{"a":[1,2.5],"b":"\\u00e9"}'  # keys sorted, no white space, ASCII
    expected = hashlib.sha256(text.encode()).hexdigest()
    assert digest_of({"b": "é", "a": (1, 2.5)}) == expected


def test_seal(nodal: Path) -> None:
    manifest = read_manifest(nodal)
    assert manifest.is_intact()
    assert manifest.sealed() == manifest
    content = json.loads((nodal / "manifest.json").read_text())
    assert content.pop("digest") == digest_of(content) == manifest.digest


def test_write_and_read_again(nodal: Path, tmp_path: Path) -> None:
    manifest = read_manifest(nodal)
    folder = tmp_path / "copy"
    folder.mkdir()
    written = write_manifest(folder, manifest.model_copy(update={"seed": 7}))
    assert read_manifest(folder) == written
    assert written.seed == 7
    assert [path.name for path in folder.iterdir()] == ["manifest.json"]


def test_exception_in_writing_keeps_the_old_text(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(UnicodeEncodeError):
        write_text(path, "new \ud800")  # a lone surrogate has no UTF-8
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
