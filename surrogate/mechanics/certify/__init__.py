"""Certification of predictions: how wrong one is, and the equilibrium nearby.

==================  ===========================================================================
`certificate`       the full certificate: the error by Newton steps from the prediction
`fast_certificate`  the fast one: a bound that holds with some probability, in real time
`fast_estimate`     the estimate that the fast certificate calibrates: steps of Lanczos
`calibrated_range`  loads and states that this calibration holds for
`conformal`         intervals of every component that hold with some probability
`correction`        Newton's method from the prediction to the equilibrium
==================  ===========================================================================

Both certificates of one prediction are an `ErrorCertificate`: an estimated error, a summary, and
the reason why a tolerance is not kept.
"""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from surrogate.mechanics.certify.calibrated_range import CalibratedRange
    from surrogate.mechanics.certify.certificate_protocol import ErrorCertificate
    from surrogate.mechanics.certify.conformal import ConformalCalibration, Intervals
    from surrogate.mechanics.certify.correction import Correction, correct, iterated
    from surrogate.mechanics.certify.fast_certificate import Bounds, FastCertificate
    from surrogate.mechanics.certify.fast_estimate import FastEstimate
    from surrogate.mechanics.certify.full_certificate import Certificate, certify

__all__ = [
    "Bounds",
    "CalibratedRange",
    "Certificate",
    "ConformalCalibration",
    "Correction",
    "ErrorCertificate",
    "FastCertificate",
    "FastEstimate",
    "Intervals",
    "certify",
    "correct",
    "iterated",
]
__getattr__, __dir__ = lazy_names(__name__)
