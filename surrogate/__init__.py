"""Learner: U-Net surrogates of large-deformation solids, trained on datasets made by `datagen`.

>>> import surrogate
>>> model = surrogate.load("beam2d_any")  # or a run folder  # doctest: +SKIP
>>> displacement = model.predict(forces)                # doctest: +SKIP
>>> solution = model.solve("4,1:0,-1.5", certify="full", tolerance=1e-3)  # doctest: +SKIP
>>> solution.save("beam.vtu")                           # doctest: +SKIP

Names are imported at their first use, so that a prediction loads no code of the training.
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.data.dataset import Dataset
    from surrogate.data.joined_dataset import read_dataset
    from surrogate.descent.aim import UnreachedToleranceWarning
    from surrogate.evaluation.learning_curves import LearningCurve, learning_curve
    from surrogate.evaluation.published import Published, read_published
    from surrogate.evaluation.run_comparison import Comparison, compare
    from surrogate.evaluation.run_evaluation import Evaluation, evaluate
    from surrogate.evaluation.run_report import write_report
    from surrogate.identification.identification import Identification, identify
    from surrogate.identification.markers import Markers
    from surrogate.inference.export import export
    from surrogate.inference.load_calibration import calibrate
    from surrogate.inference.loading import load
    from surrogate.inference.proposal import Proposal, propose
    from surrogate.inference.solution import Solution
    from surrogate.inference.surrogate import Surrogate
    from surrogate.inference.training_range import OutsideTrainingWarning
    from surrogate.page.page import write_page
    from surrogate.planning.first_configuration import first_config
    from surrogate.planning.trial_steps import dry_run
    from surrogate.runs.config_list import config_list
    from surrogate.runs.config_reader import read_config
    from surrogate.runs.config_schema import config_keys, config_schema
    from surrogate.runs.shelf import shelve, shelved
    from surrogate.runs.trained_list import trained_list
    from surrogate.touch.grip import Grip, GripFrame
    from surrogate.touch.touch import Touch, TouchFrame
    from surrogate.training.loop import train
    from surrogate.training.refinement import refine

__version__ = "0.2.0"
__all__ = [
    "Comparison",
    "Dataset",
    "Evaluation",
    "Grip",
    "GripFrame",
    "Identification",
    "LearningCurve",
    "Markers",
    "OutsideTrainingWarning",
    "Proposal",
    "Published",
    "Solution",
    "Surrogate",
    "Touch",
    "TouchFrame",
    "UnreachedToleranceWarning",
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
    "learning_curve",
    "load",
    "propose",
    "read_config",
    "read_dataset",
    "read_published",
    "refine",
    "shelve",
    "shelved",
    "train",
    "trained_list",
    "write_page",
    "write_report",
]
__getattr__, __dir__ = lazy_names(__name__)
