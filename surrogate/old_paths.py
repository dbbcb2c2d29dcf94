"""Old import paths, for one release: `surrogate.touch.grip` of `surrogate.mechanics.touch.grip`.

Both names are of one module, so that classes are the same. An import by the old one issues a
`DeprecationWarning`, and adds the names that the room had and has no more.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

PLACES = (  # old and new package, and the rooms and modules that have moved
    ("surrogate", "surrogate.runtime", "device cuda_graphs time_limit"),
    (
        "surrogate",
        "surrogate.mechanics",
        "series descent certify touch identification modal_equilibrium",
    ),
    (
        "surrogate",
        "surrogate.learning",
        "data networks probabilistic models optim training runs evaluation measures planning "
        "inference",
    ),
    ("surrogate.models", "surrogate.contrib", "pod_model"),
    ("surrogate.runs", "surrogate.runtime", "tensor_file"),
    ("surrogate.series", "surrogate.learning.data", "terms_on_grid"),
    ("surrogate.data", "surrogate.mechanics.body", "geometry elements_of_case"),
    ("surrogate.inference", "surrogate.mechanics.statics", "body"),
    ("surrogate.inference", "surrogate.mechanics.body", "stiffness"),
    (
        "surrogate.mechanics",
        "surrogate.mechanics.equilibrium",
        "block_solve compliance kept_responses linear_response "
        "newton_steps out_of_balance quadratic stresses tool_springs",
    ),
)
MOVED = {
    "surrogate.baselines": "surrogate.contrib",
    "surrogate.baselines.linear_map": "surrogate.learning.networks.linear_map",
    "surrogate.data.free_components": "surrogate.mechanics.body.geometry",
    "surrogate.mechanics.follower_pressure": "surrogate.mechanics.equilibrium.following_loads",
    "surrogate.inference.given_load": "surrogate.mechanics.statics.load",
    "surrogate.runs.config_list": "surrogate.learning.runs.shelf",
    "surrogate.runs.trained_list": "surrogate.learning.runs.shelf",
    "surrogate.seeds": "surrogate.runtime.device",
    **{f"{old}.{name}": f"{new}.{name}" for old, new, names in PLACES for name in names.split()},
}

NAMES = (  # rooms, where names that they had are now, and these
    ("baselines", "contrib.pod", "GaussianProcessConfig PODNetwork RidgeConfig"),
    ("baselines", "learning.networks.linear_map", "LinearMap"),
    ("data", "learning.data.joined_dataset", "read_dataset"),
    ("data", "learning.data.case_loads", "random_loads"),
    ("data", "learning.data.samples_on_disk", "SamplesOnDisk"),
    ("evaluation", "learning.evaluation.run_report", "Published read_published"),
    ("evaluation", "learning.evaluation.run_comparison", "Comparison compare"),
    ("evaluation", "learning.evaluation.run_evaluation", "Evaluation evaluate"),
    ("evaluation", "learning.evaluation.run_report", "write_report"),
    ("inference", "contrib.modal_fit", "fit_balance"),
    ("inference", "learning.inference.calibration", "HeldOut fit_on_samples"),
    ("inference", "learning.inference.loading", "load"),
    ("inference", "learning.inference.training_range", "OutsideTrainingWarning"),
    ("measures", "learning.measures.error_metrics", "StressMeasures measure_stresses"),
    ("models", "contrib.pod_model", "PODModel"),
    ("models", "learning.models.kinds", "RunConfig"),
    ("models", "learning.models.linear_model", "LinearModel"),
    ("models", "learning.models.model", "Gaussian"),
    ("models", "learning.models.network_model", "NetworkModel"),
    ("models", "learning.models.series_model", "SeriesModel"),
    ("networks", "learning.networks.nodal_network", "NodalNetwork"),
    (
        "networks",
        "learning.networks.reduced_network",
        "DenseNetwork ReducedConfig ReducedNetwork",
    ),
    ("optim", "learning.optim.final_weights", "EarlyStopping"),
    ("optim", "learning.optim.optimisers", "Muon"),
    (
        "optim",
        "learning.optim.optimisers",
        "EarlyStoppingConfig OptimiserConfig ScheduleConfig",
    ),
    ("optim", "learning.optim.optimisers", "make_optimisers set_learning_rate"),
    ("optim", "learning.optim.final_weights", "WeightAverage"),
    ("planning", "learning.planning.first_configuration", "FirstConfig first_config"),
    ("planning", "learning.planning.trial_steps", "DryRun dry_run"),
    ("probabilistic", "learning.probabilistic.stochastic_passes", "Ensemble"),
    ("probabilistic", "learning.probabilistic.flipout", "VariationalConvolutions"),
    ("probabilistic", "learning.probabilistic.likelihoods", "Prediction"),
    ("probabilistic", "learning.probabilistic.distribution", "Moments"),
    ("probabilistic", "learning.probabilistic.stochastic_passes", "Passes"),
    ("runs", "learning.runs.config_reader", "read_config"),
    ("training", "learning.training.loop", "train"),
)


def new_path(name: str) -> str | None:
    """Name of a module by its old one; None if it is none."""
    head, tail = name, ""
    while head.count("."):
        if head in MOVED:
            return MOVED[head] + tail
        head, _, last = head.rpartition(".")
        tail = f".{last}{tail}"
    return None


class OldPaths(MetaPathFinder, Loader):
    """Finds modules by their old names."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Point from an old name to the module."""
        new = new_path(fullname) if fullname.startswith("surrogate.") else None
        if new is None:
            return None
        said = f"'{fullname}' is '{new}' now; the old name goes in 1.1"
        warnings.warn(said, DeprecationWarning, stacklevel=2)
        return ModuleSpec(fullname, self, origin=new)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Return the module of the new name."""
        module = import_module(str(spec.origin))
        spec.loader_state = module.__spec__
        _add_names(module, spec.name.removeprefix("surrogate."))
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Leave it as it is: it has run, under its new name."""
        if module.__spec__ is not None:
            module.__spec__ = module.__spec__.loader_state


def _add_names(module: ModuleType, room: str) -> None:
    """Let a room find the names that it had, at their first use."""
    places = {
        name: f"surrogate.{place}"
        for of, place, names in NAMES
        if of == room
        for name in names.split()
    }
    find = getattr(module, "__getattr__", None)

    def find_name(name: str) -> object:
        if name in places:
            return getattr(import_module(places[name]), name)
        if find is not None:
            return find(name)
        raise AttributeError(f"module '{module.__name__}' has no attribute '{name}'")

    if places:
        vars(module)["__getattr__"] = find_name
