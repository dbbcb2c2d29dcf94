"""The help of every command, what a shell completes, and pages that are made from them."""

from __future__ import annotations

from pathlib import Path

import pytest

from datagen.cases.case import Case
from datagen.command_line import _parser, main
from shared_schema.loads.family import SHIPPED
from tests.completion import offered, write_script
from tests.help_texts import assert_described, assert_examples_parse, commands_of
from website.reference import outdated, pages_of

PARSER = _parser()


def test_pages() -> None:
    pages = pages_of("datagen")
    assert all(f"| `{key}` |" in pages["case-keys.md"] for key in Case.model_fields)
    assert all(name in pages["case-keys.md"] for name in SHIPPED)
    assert "## datagen structure\n" in pages["datagen-commands.md"]
    assert r"`--out FILE.(npz\|vtu\|xdmf)`" in pages["datagen-commands.md"]
    assert outdated("datagen") == []  # expected: python -m website.reference datagen


@pytest.mark.parametrize("name", commands_of(PARSER))
def test_every_argument_is_described(name: str) -> None:
    assert_described(PARSER, name)


@pytest.mark.parametrize("name", commands_of(PARSER))
def test_examples_are_valid(name: str) -> None:
    assert_examples_parse(PARSER, name)


@pytest.fixture
def script(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    return write_script(main, tmp_path / "datagen.bash", capsys)


def test_commands_options_and_choices(script: Path) -> None:
    assert offered(script, "datagen", "str") == ["structure"]
    assert offered(script, "datagen", "structure", "--order") == ["--order", "--order-seed"]
    assert offered(script, "datagen", "structure", "--order", "r") == ["random"]


def test_names_of_cases_and_paths(script: Path) -> None:
    (script.parent / "beam_of_mine.yaml").touch()
    for command in ("run", "solve"):
        assert offered(script, "datagen", command, "fin") == ["finger3d"]
        assert offered(script, "datagen", command, "beam_") == ["beam_of_mine.yaml"]
    assert offered(script, "datagen", "info", "datagen.b") == ["datagen.bash"]


def test_other_shells_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--print-completion", "cmd"])
    assert end.value.code == 2
    assert "choose from" in capsys.readouterr().err
