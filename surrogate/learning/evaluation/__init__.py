"""What is asked about runs: evaluation, comparison, learning curve, and a report as a page."""

from surrogate.learning.evaluation.learning_curves import LearningCurve, learning_curve
from surrogate.learning.evaluation.published import Published, read_published
from surrogate.learning.evaluation.run_comparison import Comparison, compare
from surrogate.learning.evaluation.run_evaluation import Evaluation, evaluate
from surrogate.learning.evaluation.run_report import write_report

__all__ = [
    "Comparison",
    "Evaluation",
    "LearningCurve",
    "Published",
    "compare",
    "evaluate",
    "learning_curve",
    "read_published",
    "write_report",
]
