"""Stability of equilibria: found out by the inertia of the tangent; unstable ones are left."""

from typing import TYPE_CHECKING

from shared_schema.common.lazy_names import lazy_names

if TYPE_CHECKING:
    from datagen.stability.definiteness import is_stable
    from datagen.stability.stable_equilibrium import with_stability

__all__ = ["is_stable", "with_stability"]
__getattr__, __dir__ = lazy_names(__name__)
