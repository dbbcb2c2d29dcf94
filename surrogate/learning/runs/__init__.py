"""A run: its configuration, its folder, and the split of its training samples.

`config_reader` reads configurations, such as the recipes of the package. `folder`
has the files of a run, `description` the content of its ``config.yaml``; `seal`
checks that nothing has changed. `shelf` finds the trained networks that come with the package.
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.learning.models.kinds import run_config
    from surrogate.learning.runs.config_reader import read_recipe
    from surrogate.learning.runs.description import DataFingerprint, RunDescription
    from surrogate.learning.runs.folder import RunFolder
    from surrogate.learning.runs.shelf import find_run, shelved
    from surrogate.runtime.tensor_file import load_tensors

__all__ = [
    "DataFingerprint",
    "RunDescription",
    "RunFolder",
    "find_run",
    "load_tensors",
    "read_recipe",
    "run_config",
    "shelved",
]
__getattr__, __dir__ = lazy_names(__name__)
