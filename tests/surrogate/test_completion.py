from __future__ import annotations

from pathlib import Path

import pytest

from surrogate.command_line import main
from tests.completion import offered, write_script


@pytest.fixture
def script(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    return write_script(main, tmp_path / "surrogate.bash", capsys)


def test_names_of_configurations_and_networks(script: Path) -> None:
    assert offered(script, "surrogate", "train", "plate2d") == ["plate2d-det-fast"]
    for command in ("evaluate", "predict", "compare"):
        assert "beam2d_any" in offered(script, "surrogate", command, "beam2d")
        assert offered(script, "surrogate", command, "surrogate.b") == ["surrogate.bash"]
    assert offered(script, "surrogate", "predict", "--dev") == ["--device"]
