"""The table of the recipes that come with the package."""

from __future__ import annotations

from shared_schema.common.shipped_files import shipped_files
from shared_schema.common.text_table import laid_out
from surrogate.learning.models.kinds import run_config
from surrogate.learning.runs.recipes import SHIPPED, named


def config_list() -> str:
    """Lay out name, architecture and one line of every recipe."""
    rows = [("configuration", "model", "")]
    for name, content, line in shipped_files(SHIPPED):
        config = run_config(named(content, "CASE", name), name)
        rows.append((name, config.architecture, line))
    return laid_out(rows)
