"""Every test is in `make test-all`, and in just one of `make test` and `make test-long`."""

from __future__ import annotations

import shlex

import pytest

from tests.docker.image_files import ROOT, make

INSTALLED = [f"--assume-old=.venv-{name}/.installed" for name in ("datagen", "plaid", "surrogate")]


def runs_of(target: str) -> list[tuple[str, set[str], str]]:
    """Environment, folders and selection of every run of pytest by a target."""
    found = []
    for line in make("--dry-run", *INSTALLED, target).splitlines():
        if " -m pytest " in line:
            words = shlex.split(line)
            python = next(word for word in words if word.endswith("/python"))
            folders = {word for word in words if word.startswith("tests/")}
            selections = [words[i + 1] for i, word in enumerate(words) if word == "-m"]
            found.append((python.split("/")[0], folders, " ".join(selections[1:])))
    return found


def test_every_file_is_run_in_one_environment() -> None:
    runs = runs_of("test-all")
    assert [python for python, _, _ in runs] == [".venv-datagen", ".venv-surrogate"]
    folders = [ROOT / folder for _, run, _ in runs for folder in run]
    for path in (ROOT / "tests").rglob("test_*.py"):
        assert sum(path.is_relative_to(folder) for folder in folders) == 1, path


@pytest.mark.parametrize(
    ("target", "selection"), [("test", "not slow"), ("test-long", "slow"), ("test-all", "")]
)
def test_short_and_long_parts_are_all(target: str, selection: str) -> None:
    """They are the tests without and with the mark `slow` in the same folders."""
    expected = [(python, folders, selection) for python, folders, _ in runs_of("test-all")]
    assert runs_of(target) == expected


def test_continuous_integration_runs_all() -> None:
    lines = (ROOT / ".ci" / "run").read_text().splitlines()
    targets = [line.split()[1:] for line in lines if line.startswith("make ")]
    assert targets[-1] == ["test-all", "JOBS=3"]
    assert targets[-2][-2:] == ["lint", "docs"]
