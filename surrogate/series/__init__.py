r"""The load series: displacements of a Neo-Hookean body as a series in the load.

.. math:: u = \sum_{k=1}^n c_k u_k, \qquad K u_1 = f, \qquad K u_k = \text{forces of } u_1 … u_{k-1}

`stress_series` has the terms of the stress, from which every uₖ follows; `least_energy` the
coefficients c of the least potential energy; `series_response` the response of a body, on the grid.
Modules named ``compiled_…`` compute the same under one load, in loops that Numba compiles.
`third_order` has u₂ and u₃ of a body of any material, by differences of its internal forces.
"""

from surrogate.series.series_response import SeriesResponse

__all__ = ["SeriesResponse"]
