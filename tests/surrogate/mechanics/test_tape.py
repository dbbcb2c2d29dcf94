"""Tapes of powers: few operations, whatever the exponent is."""

from __future__ import annotations

import pytest
import sympy  # type: ignore[import-untyped]

from surrogate.mechanics.energy.tape import Tape


@pytest.mark.parametrize("exponent", [1, 7, 9, 17, 1000, -3, -1000, 2.5, -1000.25, 1e12])
def test_powers(exponent: float) -> None:
    """Those of 1 + 1/n and of 1 are the numbers of Python, to rounding times the exponent."""
    x = sympy.Symbol("x", positive=True)
    number = int(exponent) if float(exponent).is_integer() else exponent
    tape = Tape.of([x**number], [x])
    assert len(tape.codes) <= 85  # two for each of 40 bits
    base = 1 + 1 / abs(exponent)
    for value in (1.0, base):
        error = 4e-16 * max(1, abs(exponent)) if value != 1 else 0
        assert tape([value])[0] == pytest.approx(value**exponent, rel=max(error, 1e-15))
