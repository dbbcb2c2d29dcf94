"""A compilation that was killed, as ffcx tells of it."""

from __future__ import annotations

from typing import Any

import pytest

from datagen import dolfinx_versions
from shared_schema.common.errors import WorkError


def test_the_file_to_delete_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def waits(*_: Any, **__: Any) -> None:
        raise TimeoutError("JIT compilation timed out, try removing /cache/lib.c")

    monkeypatch.setattr("dolfinx.fem.form", waits)
    with pytest.raises(WorkError, match=r"was killed: JIT compilation .* /cache/lib\.c$"):
        dolfinx_versions.form(None, {})
