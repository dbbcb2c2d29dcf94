"""Pictures of the shipped organs for the documentation: prediction, error and certificate.

    .venv-surrogate/bin/python -m tools.organ_pictures

writes `docs/figures/organ-breast3d.png` and `docs/figures/organ-liver3d.png`, of body forces inside
the range of the training; errors are those against the equilibrium of the finite elements.
"""

from __future__ import annotations

from pathlib import Path

from shared_schema.common.drawing import save
from surrogate import load
from surrogate.figures import error_beside_certificate

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
BODY_FORCES = {"breast3d": (2000, -4000, 1500), "liver3d": (300, -200, 500)}  # N/m³


def main() -> None:
    """Write both."""
    for name, body_force in BODY_FORCES.items():
        model = load(name)
        found = model.solve(body_force=body_force, certify="full")
        truth = model.correct(found.force, found.displacement).displacement
        assert found.estimated_error is not None
        fields = found.displacement, truth, found.estimated_error
        figure = error_beside_certificate(model.geometry, *fields)
        save(figure, FIGURES / f"organ-{name}.png")


if __name__ == "__main__":
    main()
