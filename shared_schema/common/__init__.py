"""Code of both programs beside the contract: errors, configuration, command line, files, loads.

Figures are in `shared_schema.common.drawing`, which needs matplotlib.
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from shared_schema.common.bodies.nodal_forces import scatter_forces
    from shared_schema.common.command_line import (
        Commands,
        Parser,
        add_command,
        add_set,
        make_parser,
        run_command,
    )
    from shared_schema.common.configuration import (
        Frozen,
        changed,
        read_named,
        read_yaml,
        source_of,
        validate,
    )
    from shared_schema.common.errors import InputError, WorkError
    from shared_schema.common.files import complete_or_absent, require_writable, write_text
    from shared_schema.common.machine import largest_resident, processor
    from shared_schema.common.progress import Progress

__all__ = [
    "Commands",
    "Frozen",
    "InputError",
    "Parser",
    "Progress",
    "WorkError",
    "add_command",
    "add_set",
    "changed",
    "complete_or_absent",
    "largest_resident",
    "make_parser",
    "processor",
    "read_named",
    "read_yaml",
    "require_writable",
    "run_command",
    "scatter_forces",
    "source_of",
    "validate",
    "write_text",
]
__getattr__, __dir__ = lazy_names(__name__)
