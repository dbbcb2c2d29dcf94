"""Before a training: a first configuration for a dataset, and what its training takes."""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.learning.planning.first_configuration import FirstConfig, first_config
    from surrogate.learning.planning.trial_steps import DryRun, dry_run

__all__ = [
    "DryRun",
    "FirstConfig",
    "dry_run",
    "first_config",
]
__getattr__, __dir__ = lazy_names(__name__)
