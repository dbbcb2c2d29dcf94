"""What is asked about runs: evaluation, comparison, learning curve, and a report as a page."""

from surrogate.evaluation.learning_curves import LearningCurve, learning_curve
from surrogate.evaluation.published import Published, read_published
from surrogate.evaluation.run_comparison import Comparison, compare
from surrogate.evaluation.run_evaluation import Evaluation, evaluate
from surrogate.evaluation.run_report import write_report

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
