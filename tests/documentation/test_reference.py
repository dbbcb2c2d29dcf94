"""Pages of the reference that are made from the learner; `tests/datagen` has those of the factory."""

from __future__ import annotations

from surrogate.command_line import _parser
from surrogate.models.training_config import TrainingConfig
from surrogate.runs.configuration import KINDS
from website.model_keys import documented, keys_page
from website.reference import commands_of, commands_page, pages_of


def test_every_command_and_argument_is_described() -> None:
    page = commands_page("surrogate")
    for name, command in commands_of(_parser()).items():
        assert f"## surrogate {name}\n" in page
        for action in command._actions:
            assert action.dest == "help" or any(
                word in page for word in (*action.option_strings, f"`{action.metavar}`")
            )


def test_every_key_is_described() -> None:
    page = pages_of("surrogate")["configuration-keys.md"]
    for model in KINDS.values():
        assert all(f"| `{key}` |" in page for key in model.model_fields)
    assert all(f"| `{key}` |" in page for key in TrainingConfig.model_fields)


def test_types_bounds_and_defaults() -> None:
    """Those of `SplitConfig.validation_fraction`, and its meaning from the docstring."""
    page = keys_page("", "", {"training": TrainingConfig})
    (row,) = (line for line in page.splitlines() if line.startswith("| `validation_fraction`"))
    meaning = documented(TrainingConfig)["validation_fraction"]
    assert row == f"| `validation_fraction` | {meaning} *number, ≥ 0, < 1; default `0.0`* |"
    assert meaning.startswith("Fraction for the loss curve")
