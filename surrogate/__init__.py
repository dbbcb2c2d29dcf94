"""Learner: U-Net surrogates of large-deformation solids, trained on datasets made by `datagen`.

>>> import surrogate
>>> model = surrogate.load("beam2d_any")  # or a run folder  # doctest: +SKIP
>>> displacement = model.predict(forces)                # doctest: +SKIP
"""

from surrogate.inference.loading import load
from surrogate.inference.prediction import Surrogate
from surrogate.inference.training_range import OutsideTrainingWarning

__version__ = "0.2.0"
__all__ = ["OutsideTrainingWarning", "Surrogate", "load"]
