"""Pictures of predictions, their errors and their certificates for the documentation.

    .venv-surrogate/bin/python -m tools.certificate_pictures

writes `docs/figures/certificate.png` of the L-shape, and `organ-breast3d.png` and
`organ-liver3d.png` of body forces inside the range of the training; errors are those against the
equilibrium of the finite elements.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from shared_schema.common.drawing import save
from surrogate import load
from surrogate.figures.field_figures import error_beside_certificate

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
SHOWN: dict[str, tuple[str, dict[str, Any]]] = {
    "certificate": ("lshape2d_any", {"load": "6,2:0,-1"}),
    "organ-breast3d": ("breast3d", {"body_force": (2000, -4000, 1500)}),  # N/m³
    "organ-liver3d": ("liver3d", {"body_force": (300, -200, 500)}),
}


def main() -> None:
    """Write all."""
    for picture, (name, loads) in SHOWN.items():
        model = load(name)
        found = model.solve(**loads, certify="full")
        truth = model.correct(found.force, found.displacement).displacement
        assert found.estimated_error is not None
        fields = found.displacement, truth, found.estimated_error
        save(error_beside_certificate(model.geometry, *fields), FIGURES / f"{picture}.png")


if __name__ == "__main__":
    main()
