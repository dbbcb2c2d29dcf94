"""What few use, without a promise of stability; nothing else imports it (`surrogate.extensions`).

=================================  ==============================================================
`pod_model`, `pod`                 baselines: orthogonal modes with one of two
                                   `regressions`; key `model: pod`
`modal_fit`, `balance`             the cubature of an equilibrium in modes, and its command
=================================  ==============================================================
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.contrib.modal_fit import fit_balance

__all__ = ["fit_balance"]
__getattr__, __dir__ = lazy_names(__name__)
