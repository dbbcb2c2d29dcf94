from __future__ import annotations

from pathlib import Path

import pytest

from datagen.command_line import main
from tests.completion import offered, write_script


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
