"""Commands of the learner run in the process of the tests, on one thread as everywhere in them."""

from tests.surrogate.conftest import _one_thread

__all__ = ["_one_thread"]
