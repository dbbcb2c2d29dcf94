"""The fuzz itself: its attacks depend on the seed alone, and it sees what it must."""

from __future__ import annotations

import json
from pathlib import Path
from random import Random
from typing import Any

import h5py
import pytest

from tools.fuzz.attacks import judged
from tools.fuzz.material import digests
from tools.fuzz.mutations import change_file, change_text, change_words

RIGHT = {"code": 2, "ended": "itself", "stdout": "", "stderr": "datagen: error: --out\n"}


@pytest.mark.parametrize("seed", range(40))
def test_a_change_is_a_change_and_the_same_again(seed: int, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    content = json.dumps({"a": [1, 2.5], "b": {"c": "text"}}).encode()
    found = []
    for _ in range(2):
        path.write_bytes(content)
        change_file(Random(seed), path)
        found.append(path.read_bytes() if path.exists() else None)
    assert found[0] == found[1] != content
    words = ["run", "case.yaml", "--out", "out"]
    assert change_words(Random(seed), words) == change_words(Random(seed), words)
    text = "a: 1\nb: {c: 2}\n"
    assert change_text(Random(seed), text) == change_text(Random(seed), text)


@pytest.mark.parametrize(
    ("answer", "finding"),
    [
        ({}, ""),
        ({"code": 0}, ""),
        ({"code": 1, "stderr": "Traceback (most recent call last):\n  …"}, "traceback"),
        ({"code": -11}, "crash (-11)"),
        ({"code": 59}, "crash (59)"),
        ({"code": -9, "ended": "hang"}, "hang"),
        ({"code": -9, "ended": "hang", "stderr": "run: 12/99 samples, 1.0/s, 9 s left"}, ""),
        ({"code": 1, "stderr": ""}, "fails without a word"),
    ],
)
def test_findings(answer: dict[str, Any], finding: str) -> None:
    assert judged(RIGHT | answer) == finding


def test_results_are_compared_without_times(tmp_path: Path) -> None:
    found = []
    for time, value in ((1.0, 3.0), (2.0, 3.0), (2.0, 4.0)):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["samples/wall_time"] = [time]
            file["samples/force"] = [value]
        (tmp_path / "a.json").write_text(json.dumps({"seconds": time, "error": [value]}))
        found.append(digests(tmp_path))
    assert found[0]["a.h5"] == found[1]["a.h5"] != found[2]["a.h5"]
    assert found[0]["a.json.error.0"] == found[1]["a.json.error.0"] == "3.0"
