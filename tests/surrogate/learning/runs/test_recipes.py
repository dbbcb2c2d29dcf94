"""Recipes: found by name, for one case or for all, whose name the dataset then gives."""

from __future__ import annotations

from pathlib import Path

import pytest

from shared_schema.common.errors import InputError
from surrogate.command_line import main
from surrogate.learning.data.dataset import Dataset
from surrogate.learning.runs.config_reader import SHIPPED, file_of, read_config, read_recipe
from surrogate.learning.runs.folder import RunFolder
from tests.surrogate.recipe_names import NAMES


@pytest.mark.parametrize("name", NAMES)
def test_recipes_for_a_case_are_valid_and_named_as_they_are_called(name: str) -> None:
    config = read_config(name)
    assert config.name == name
    assert config.case == name.split("-")[0]


def test_every_file_is_one_of_them() -> None:
    used = {Path(read_recipe(name)[1]) for name in NAMES}
    assert used == set(SHIPPED.glob("*.yaml"))


@pytest.mark.parametrize(
    ("case", "recipe", "file"),
    [
        ("beam2d", "det-fast", "det-fast"),
        ("finger", "det-fast", "det-fast"),
        ("beam3d", "det-fast", "beam3d-det-fast"),
        ("lshape2d_any", "det-fast", "any-det-fast"),
        ("lshape2d_any", "any-det-fast", "any-det-fast"),
        ("beam3d_any", "det-fast", "beam3d_any-det-fast"),
        ("beam2d_any", "reduced-fast", "reduced-fast"),
    ],
)
def test_numbers_of_a_case_go_before_those_of_all(case: str, recipe: str, file: str) -> None:
    assert file_of(recipe, case) == SHIPPED / f"{file}.yaml"


def test_the_dataset_names_the_case(dataset: Dataset, data: Path, tmp_path: Path) -> None:
    """By the dataset or its folder; of a file without a case likewise."""
    case = dataset.manifest.name
    expected = read_config(f"{case}-det-fast")
    assert read_config("det-fast", data=dataset) == expected
    assert read_config("det-fast", data=data) == read_config("det-fast", data=[data]) == expected
    own = tmp_path / "own.yaml"
    own.write_text("seed: 3")
    assert read_config(str(own), data=dataset).name == f"{case}-own"
    own.write_text("seed: 3\nname: mine")
    config = read_config(str(own), data=dataset)
    assert (config.name, config.case, config.seed) == ("mine", case, 3)


def test_a_name_of_a_case_is_checked(
    dataset: Dataset, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert read_config("lshape2d-det-fast", data=dataset).case == "lshape2d"
    words = ["train", "lshape2d-det-fast", "--data", str(data), "--out", str(tmp_path / "run")]
    assert main(words) == 2
    assert "'case' = 'lshape2d', the dataset is of case 'beam2d'" in capsys.readouterr().err


def test_training(data: Path, tmp_path: Path) -> None:
    """The run is called CASE-RECIPE, however the recipe was named."""
    descriptions = []
    for name in ("pod-fast", "beam2d-pod-fast"):
        run = tmp_path / name
        words = ["train", name, "--data", str(data), "--out", str(run)]
        assert main(words) == 0
        descriptions.append(RunFolder(run).description())
    assert descriptions[0] == descriptions[1]
    assert descriptions[0].run.name == "beam2d-pod-fast"


def test_without_a_dataset_the_case_is_missing() -> None:
    with pytest.raises(InputError, match="config 'det-fast': a recipe for all cases, expected CAS"):
        read_config("det-fast")
    with pytest.raises(InputError, match="config 'runs/beam2d-det-fast': no such file"):
        read_config("runs/beam2d-det-fast")
