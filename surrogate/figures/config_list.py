"""The table of the configurations that come with the package."""

from __future__ import annotations

from shared_schema.common.shipped_files import shipped_files
from shared_schema.common.text_table import laid_out
from surrogate.runs.run_config import SHIPPED, run_config


def config_list() -> str:
    """Lay out name, architecture and one line of every shipped configuration."""
    rows = [("configuration", "model", "")]
    for name, content, line in shipped_files(SHIPPED):
        rows.append((name, run_config(content, name).architecture, line))
    return laid_out(rows)
