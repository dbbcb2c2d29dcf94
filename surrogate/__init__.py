"""Learner: U-Net surrogates of large-deformation solids, trained on datasets made by `datagen`.

>>> import surrogate
>>> model = surrogate.load("beam2d_any")  # or a run folder  # doctest: +SKIP
>>> displacement = model.predict(forces)                # doctest: +SKIP
>>> solution = model.solve("4,1:0,-1.5", certify="full", tolerance=1e-3)  # doctest: +SKIP
>>> solution.save("beam.vtu")                           # doctest: +SKIP

Names are imported at their first use, so that a prediction loads no code of the training.
"""

import sys
from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names
from surrogate.old_paths import OldPaths

if TYPE_CHECKING:
    from surrogate.learning.data.dataset import Dataset
    from surrogate.learning.data.joined_dataset import read_dataset
    from surrogate.learning.evaluation.run_comparison import Comparison, compare
    from surrogate.learning.evaluation.run_evaluation import Evaluation, evaluate
    from surrogate.learning.evaluation.run_report import Published, read_published, write_report
    from surrogate.learning.inference.calibration import calibrate
    from surrogate.learning.inference.export import export
    from surrogate.learning.inference.loading import load
    from surrogate.learning.inference.solution import Solution
    from surrogate.learning.inference.surrogate import Surrogate
    from surrogate.learning.inference.training_range import OutsideTrainingWarning
    from surrogate.learning.models.kinds import add_model
    from surrogate.learning.models.model import Deterministic, MaximumLikelihood
    from surrogate.learning.models.network_model import NetworkModel
    from surrogate.learning.planning.first_configuration import first_config
    from surrogate.learning.planning.trial_steps import dry_run
    from surrogate.learning.runs.config_reader import config_keys, config_schema, read_config
    from surrogate.learning.runs.shelf import config_list, shelve, shelved, trained_list
    from surrogate.learning.training.loop import train
    from surrogate.mechanics.actuation.actuation import ActuatedState, Actuation
    from surrogate.mechanics.actuation.controller import ControlFrame, Controller
    from surrogate.mechanics.descent.aim import UnreachedToleranceWarning
    from surrogate.mechanics.identification.identification import Identification, identify
    from surrogate.mechanics.identification.markers import Markers
    from surrogate.mechanics.motion.frame import Frame
    from surrogate.mechanics.motion.reduced_motion import ReducedMotion
    from surrogate.mechanics.motion.session import Session
    from surrogate.mechanics.sampling.sampling import sample
    from surrogate.mechanics.touch.grip import Grip, GripFrame
    from surrogate.mechanics.touch.touch import Touch, TouchFrame
    from surrogate.page.network_of_body import network_of_body
    from surrogate.page.page import write_page
    from surrogate.page.shape import page_of_shape

__version__ = "1.0.0"
__all__ = [
    "ActuatedState",
    "Actuation",
    "Comparison",
    "ControlFrame",
    "Controller",
    "Dataset",
    "Deterministic",
    "Evaluation",
    "Frame",
    "Grip",
    "GripFrame",
    "Identification",
    "Markers",
    "MaximumLikelihood",
    "NetworkModel",
    "OutsideTrainingWarning",
    "Published",
    "ReducedMotion",
    "Session",
    "Solution",
    "Surrogate",
    "Touch",
    "TouchFrame",
    "UnreachedToleranceWarning",
    "add_model",
    "calibrate",
    "compare",
    "config_keys",
    "config_list",
    "config_schema",
    "dry_run",
    "evaluate",
    "export",
    "first_config",
    "identify",
    "load",
    "network_of_body",
    "page_of_shape",
    "read_config",
    "read_dataset",
    "read_published",
    "sample",
    "shelve",
    "shelved",
    "train",
    "trained_list",
    "write_page",
    "write_report",
]
sys.meta_path.insert(0, OldPaths())
__getattr__, __dir__ = lazy_names(__name__)
