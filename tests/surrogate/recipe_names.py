"""Names of the recipes for the cases that the paper, the studies and the shipped networks have."""

from __future__ import annotations

PLANE = (
    "det-fast det-paper dropout-fast ensemble-fast gp-fast linear-fast mle-fast mle-paper pod-fast "
    "vb-fast vb-paper"
)
ANY_PLANE = (
    "det-fast ensemble-fast gp-fast mle-fast modal-gp-fast reduced-fast reduced-vb-fast vb-fast"
)
RECIPES = {
    "beam2d": f"{PLANE} mechanics-fast",
    "lshape2d": PLANE,
    "beam2d_any": f"{ANY_PLANE} reduced-mle-fast",
    "lshape2d_any": ANY_PLANE,
    "plate2d": "det-fast series",
    "beam3d": "det-fast det-paper linear-fast reduced-fast reduced-mle-fast reduced-vb-fast",
    "beam3d_any": "series det-fast gp-fast modal-gp-fast reduced-fast reduced-vb-fast",
    "finger3d": "reduced-fast reduced-vb-fast",
}
NAMES = [f"{case}-{recipe}" for case, recipes in RECIPES.items() for recipe in recipes.split()]
