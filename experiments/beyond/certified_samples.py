"""Test samples with their certificates, and claims on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from experiments.beyond.alarms import Judged, judge
from experiments.components.errors_on_test_split import MM
from experiments.framework.resources import Resources
from experiments.framework.study_record import Claim, Table
from surrogate.certify.certificate import certify
from surrogate.certify.correction import correct
from surrogate.evaluation.error_metrics import sample_errors
from surrogate.inference.surrogate import Surrogate

Array = NDArray[np.float64]
SAMPLES = {2: 300, 3: 60}  # of the test split, by the dimension of the body
EFFECTIVE, MOST_WITHIN, WITHIN = (0.95, 1.05), 0.9, (0.8, 1.5)
RANKED = {2: 0.99, 3: 0.95}
LOWERED, LOWERED_TWICE = {2: 10.0, 3: 6.0}, 100.0
ALARMED = 0.99
COVERED, WIDE = 0.02, 3.0
SETTLED = 1e-11  # N; datasets are solved to 1e-8 N, and errors of some networks are as small
OURS = "estimated error over displacement"


@dataclass(frozen=True)
class Certified:
    """Test samples of a run with their certificates.

    Attributes
    ----------
    surrogate : Surrogate
    force, truth, predicted : array, (N, n_nodes, d)
    judged : Judged
    errors : tuple of 3 arrays, (N,)
        Mean errors in m of the predictions, and after one and two corrections.
    """

    surrogate: Surrogate
    force: Array
    truth: Array
    predicted: Array
    judged: Judged
    errors: tuple[Array, Array, Array]

    @property
    def dimension(self) -> int:
        """Number of space dimensions d."""
        return int(self.force.shape[2])

    @property
    def effectivity(self) -> Array:
        """Estimated over true mean errors, (N,)."""
        result: Array = self.judged.certificate.mean_error / self.errors[0]
        return result


def certified(resources: Resources, run: str) -> Certified:
    """Certify the predictions of a run on its test split, and correct them twice."""
    surrogate, test = resources.surrogate(run), resources.dataset_of(run).nodal_test
    count = SAMPLES[test.force.shape[2]]
    force = test.force[:count]
    truth = settled(surrogate, force, test.displacement[:count])
    predicted = resources.predicted_test(run).mean[:count]
    judged = judge(surrogate, force, resources.scale.passes)
    once = predicted - finite(judged.certificate.error)
    twice = once - finite(certify(surrogate.equilibrium, force, once).error)
    before, after, last = (sample_errors(u, truth) for u in (predicted, once, twice))
    return Certified(surrogate, force, truth, predicted, judged, (before, after, last))


def settled(surrogate: Surrogate, force: Array, truth: Array) -> Array:
    """Solutions of a dataset without what the tolerance of the finite elements leaves."""
    body = surrogate.equilibrium
    return np.stack(
        [correct(body, f, u, SETTLED).displacement for f, u in zip(force, truth, strict=True)]
    )


def finite(error: Array) -> Array:
    """Estimated errors in m, none where there is no estimate."""
    result: Array = np.where(np.isfinite(error), error, 0.0)
    return result


def within(ratio: Array) -> float:
    """Share of effectivities within the limits of the claim."""
    return float(((ratio >= WITHIN[0]) & (ratio <= WITHIN[1])).mean())


def claims(name: str, one: Certified) -> list[Claim]:
    """Claims on the estimates and corrections of a run."""
    ratio, d = one.effectivity, one.dimension
    middle, share = float(np.median(ratio)), within(ratio)
    rank = float(spearmanr(one.errors[0], one.judged.certificate.mean_error)[0])
    before, once, twice = (float(np.median(error)) for error in one.errors)
    raised = int((one.errors[1] > one.errors[0]).sum())
    return [
        Claim(
            what=f"{name}: the certificate estimates the size of the error.",
            holds=EFFECTIVE[0] <= middle <= EFFECTIVE[1] and share >= MOST_WITHIN,
            evidence=f"Median effectivity {middle:.4g}, {100 * share:.3g} % within {WITHIN[0]:g} "
            f"to {WITHIN[1]:g}.",
            of_paper=False,
        ),
        Claim(
            what=f"{name}: the certificate ranks predictions by their error.",
            holds=rank >= RANKED[d],
            evidence=f"Rank correlation {rank:.4f} (≥ {RANKED[d]:g}).",
            of_paper=False,
        ),
        Claim(
            what=f"{name}: corrections lower the error, and raise none.",
            holds=before >= LOWERED[d] * once and before >= LOWERED_TWICE * twice and not raised,
            evidence=f"Median error {MM * before:.3g}, then {MM * once:.3g} and {MM * twice:.3g} "
            f"mm (≥ {LOWERED[d]:g} and {LOWERED_TWICE:g} times); {raised} raised by the first.",
            of_paper=False,
        ),
    ]


def alarm_claims(table: Table) -> list[Claim]:
    """Claims on the alarms for networks of single loads."""
    found = []
    for name, alarm, *areas in table.rows:
        values = {kind: a for kind, a in zip(table.head[2:], areas, strict=True) if a is not None}
        if alarm == OURS:
            listed = ", ".join(f"{kind} {area:.4f}" for kind, area in values.items())
            found.append(
                Claim(
                    what=f"{name}: the certificate gives an alarm for every kind of load outside "
                    "the training.",
                    holds=all(float(area) >= ALARMED for area in values.values()),
                    evidence=f"AUROC: {listed} (each ≥ {ALARMED:g}).",
                    of_paper=False,
                )
            )
    return found


def fast_claims(table: Table) -> list[Claim]:
    """Claims on the fast certificates."""
    found = []
    for name, held, lower, upper, _, width, _, _ in table.rows:
        shares = [float(share or 0) / 100 for share in (lower, upper)]
        off = [abs(share - level) for share, level in zip(shares, (0.9, 0.95), strict=True)]
        found.append(
            Claim(
                what=f"{name}: the fast bounds hold as often as they say, and are narrow.",
                holds=max(off) <= COVERED and float(width or 0) <= WIDE,
                evidence=f"{shares[0]:.1%} of 90 % and {shares[1]:.1%} of 95 % (within "
                f"{100 * COVERED:g} %), {held} held-out samples; median width {width:.3g} times "
                f"the error (≤ {WIDE:g}).",
                of_paper=False,
            )
        )
    return found
