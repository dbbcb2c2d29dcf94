"""Pages of the reference made from the learner; `tests/datagen` has those of the factory."""

from __future__ import annotations

from shared_schema.common.configuration_keys import Key
from surrogate.command_line import _parser
from surrogate.learning.models.kinds import kinds
from surrogate.learning.models.training_config import TrainingConfig
from website.key_tables import keys_page
from website.reference import commands_of, commands_page, outdated, pages_of


def test_every_command_and_argument_is_described() -> None:
    page = commands_page("surrogate")
    for name, command in commands_of(_parser()).items():
        assert f"## surrogate {name}\n" in page
        for action in command._actions:
            shown = str(action.metavar).replace("|", r"\|")
            assert action.dest == "help" or any(
                word in page for word in (*action.option_strings, f"`{shown}`")
            )


def test_every_key_is_described() -> None:
    page = pages_of("surrogate")["configuration-keys.md"]
    for model in kinds().values():
        assert all(f"| `{key}` |" in page for key in model.model_fields)
    assert all(f"| `{key}` |" in page for key in TrainingConfig.model_fields)


def test_pages_are_up_to_date() -> None:
    assert outdated("surrogate") == []  # expected: python -m website.reference surrogate


def test_a_row() -> None:
    """Made up: a key of a section, with a bar, which would end the cell."""
    key = Key("mesh.size", "kind: a | b", "number > 0", "m", "1", "Its size.")
    lines = keys_page("Keys", "", [key]).splitlines()
    assert "## `mesh`" in lines
    assert lines[-1] == (
        r"| `size` | Its size.<br>*number > 0 in m; default `1`; only kind: a \| b* |"
    )
