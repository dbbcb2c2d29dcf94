from __future__ import annotations

from pathlib import Path

import pytest

from surrogate.command_line import main
from tests.completion import offered


@pytest.fixture
def script(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    with pytest.raises(SystemExit) as end:
        main(["--print-completion", "bash"])
    assert end.value.code == 0
    path = tmp_path / "surrogate.bash"
    path.write_text(capsys.readouterr().out)
    return path


def test_names_of_configurations_and_networks(script: Path) -> None:
    assert offered(script, "surrogate", "train", "plate2d") == ["plate2d-det-fast"]
    for command in ("evaluate", "predict", "compare"):
        assert "beam2d_any" in offered(script, "surrogate", command, "beam2d")
        assert offered(script, "surrogate", command, "surrogate.b") == ["surrogate.bash"]
    assert offered(script, "surrogate", "predict", "--dev") == ["--device"]
