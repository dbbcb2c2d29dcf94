r"""The load series: displacements of a body as a series in the load.

.. math:: u = \sum_{k=1}^n c_k u_k, \qquad K u_1 = f, \qquad K u_k = \text{forces of } u_1 … u_{k-1}

`body_series` is that of any material, element and load, on any device, in exported files and with
gradients, from the terms of the stress
(`surrogate.mechanics.solids.stress_path`) and of pressures in `following_terms`,
with the `weights` nearest to equilibrium. Modules named ``compiled_…`` compute the same under dead
loads, in loops that Numba compiles. `series_response` is the response on the grid, for networks.
"""

from surrogate.mechanics.series.series_response import SeriesResponse

__all__ = ["SeriesResponse"]
