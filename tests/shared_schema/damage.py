"""Damaging an intact dataset in one place: what the tests of the checker share."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py

from shared_schema.checker import check_dataset
from shared_schema.common.files import sha256
from shared_schema.manifest import digest_of

SHARD = "shard-00000.h5"


def edit_manifest(folder: Path, edit: Callable[[dict[str, Any]], None], seal: bool = True) -> None:
    path = folder / "manifest.json"
    content = json.loads(path.read_text())
    edit(content)
    if seal:
        content["digest"] = digest_of({k: v for k, v in content.items() if k != "digest"})
    path.write_text(json.dumps(content, indent=1) + "\n")


def update_checksums(folder: Path) -> None:
    def edit(content: dict[str, Any]) -> None:
        for entry in content["shards"]:
            if (folder / entry["file"]).is_file():
                entry["sha256"] = sha256(folder / entry["file"])

    edit_manifest(folder, edit)


def damage(folder: Path, change: Callable[[h5py.File], None]) -> None:
    with h5py.File(folder / SHARD, "r+") as file:
        change(file)
    update_checksums(folder)


def assert_only_problem(folder: Path, *parts: str) -> None:
    problems = check_dataset(folder)
    assert len(problems) == 1, problems
    for part in parts:
        assert part in problems[0]
    assert "\n" not in problems[0]
