"""Every study, in the order of the report: the paper's tables, then its figures."""

from surrogate.studies import deterministic_accuracy
from surrogate.studies.study import Study

STUDIES: tuple[Study, ...] = (deterministic_accuracy.STUDY,)
