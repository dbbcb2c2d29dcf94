r"""A strain energy and its derivatives as one list of scalar operations: a *tape*.

The energy :math:`ψ(I_1, I_2, J, …)` of a material (`shared_schema.materials`) is differentiated by
SymPy, once, and what its derivatives have in common is computed once. The result is data: what runs
it, with numbers, tensors or power series, is the same for every material, a user's own among them.

The coefficients of the power series of a result y of a and b are, for k ≥ 1,

.. math::
    y_k = \frac{∂y}{∂a} a_k + \frac{∂y}{∂b} b_k + \sum_{j=1}^{k-1} w_{jk} \, a_j z_{k-j}

with the derivatives at the coefficients of order 0, and z = y, or z = b in a product:

==========  ====================  ==================  =====================
operation   value                 derivatives         weight :math:`w_{jk}`
==========  ====================  ==================  =====================
SUM         a + b                 1, 1                0
SCALE       c a                   c                   0
SHIFT       a + c                 1                   0
PRODUCT     a b                   b₀, a₀              1
POWER       y = a^c               c y₀ / a₀           (c j − k + j) / (k a₀)
EXP         y = exp a             y₀                  j / k
LN          y = ln a              1 / a₀              (j − k) / (k a₀)
POSITIVE    max(a, 0)             1 if a₀ ≥ 0, or 0   0
STEP        1 if a ≥ 0, or 0      0                   0
==========  ====================  ==================  =====================

A number above −`shared_schema.materials.ZERO` counts as no less than 0, as in the energy itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from types import ModuleType
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import sympy  # type: ignore[import-untyped]
from numpy.typing import NDArray

from shared_schema.materials import ZERO

Values: TypeAlias = Any  # numbers, arrays or tensors
FACTORS = 8  # most factors of a whole power that are multiplied one after the other
WHOLE = 1e-12  # largest distance of an exponent from a whole number that is a rounding error


class Operation(IntEnum):
    """Operations of a tape."""

    SUM = 0
    SCALE = 1
    SHIFT = 2
    PRODUCT = 3
    POWER = 4
    EXP = 5
    LN = 6
    POSITIVE = 7
    STEP = 8


class Rule(NamedTuple):
    """What an operation of a and b finds, with a constant c.

    Attributes
    ----------
    value : callable
        y of a, b, c and the library of their functions.
    slopes : callable
        Derivatives of y by a and b, of numbers a, b, y and c.
    weight : callable, or None if there are no products
        Weight of the product of order (j, k - j), of j, k, and numbers a and c.
    """

    value: Callable[[Values, Values, float, Any], Values]
    slopes: Callable[[float, float, float, float], tuple[float, float]]
    weight: Callable[[int, int, float, float], float] | None = None


def _is_positive(a: Values) -> Values:
    return a > -ZERO


RULES = {
    Operation.SUM: Rule(lambda a, b, c, of: a + b, lambda a, b, y, c: (1.0, 1.0)),
    Operation.SCALE: Rule(lambda a, b, c, of: c * a, lambda a, b, y, c: (c, 0.0)),
    Operation.SHIFT: Rule(lambda a, b, c, of: a + c, lambda a, b, y, c: (1.0, 0.0)),
    Operation.PRODUCT: Rule(
        lambda a, b, c, of: a * b, lambda a, b, y, c: (b, a), lambda j, k, a, c: 1.0
    ),
    Operation.POWER: Rule(
        lambda a, b, c, of: 1 / a if c == -1 else a**c,
        lambda a, b, y, c: (c * y / a, 0.0),
        lambda j, k, a, c: (c * j - k + j) / (k * a),
    ),
    Operation.EXP: Rule(
        lambda a, b, c, of: of.exp(a), lambda a, b, y, c: (y, 0.0), lambda j, k, a, c: j / k
    ),
    Operation.LN: Rule(
        lambda a, b, c, of: of.log(a),
        lambda a, b, y, c: (1 / a, 0.0),
        lambda j, k, a, c: (j - k) / (k * a),
    ),
    Operation.POSITIVE: Rule(
        lambda a, b, c, of: a * _is_positive(a),
        lambda a, b, y, c: (float(_is_positive(a)), 0.0),
    ),
    Operation.STEP: Rule(lambda a, b, c, of: 1.0 * _is_positive(a), lambda a, b, y, c: (0.0, 0.0)),
}


class step(sympy.Function):  # type: ignore[misc]  # noqa: N801 - as it is printed
    """Derivative of `positive`: 1 where the argument is not negative, else 0."""

    def fdiff(self, argindex: int = 1) -> sympy.Expr:
        """Zero."""
        return sympy.Integer(0)


class positive(sympy.Function):  # type: ignore[misc]  # noqa: N801
    """The larger one of the argument and 0."""

    def fdiff(self, argindex: int = 1) -> sympy.Expr:
        """The step."""
        return step(self.args[0])


@dataclass(frozen=True)
class Tape:
    """Operations on slots: first the inputs, then the result of every operation.

    Attributes
    ----------
    inputs : int
        Number of inputs.
    codes : array of int, (n,)
        `Operation` of every result.
    left, right : array of int, (n,)
        Slots that it takes; `right` has no meaning for operations of one.
    constants : array, (n,)
        c.
    outputs : array of int, (m,)
        Slot of every output; −1 if it is the same number whatever the inputs are.
    fixed : array, (m,)
        These numbers; 0 for others.
    """

    inputs: int
    codes: NDArray[np.int64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    constants: NDArray[np.float64]
    outputs: NDArray[np.int64]
    fixed: NDArray[np.float64]

    def __call__(self, inputs: Sequence[Values], library: ModuleType = np) -> list[Values]:
        """Run the tape on numbers, arrays or tensors; outputs that are fixed are numbers.

        Parameters
        ----------
        inputs : sequence of values
        library : module
            NumPy, or PyTorch for tensors.
        """
        slots = self.slots(inputs, library)
        return [number if slot < 0 else slots[slot] for slot, number in self.places]

    def slots(self, inputs: Sequence[Values], library: ModuleType = np) -> list[Values]:
        """Values of the inputs and of all operations."""
        found = list(inputs)
        for code, left, right, constant in self.rows:
            found.append(RULES[code].value(found[left], found[right], constant, library))
        return found

    @cached_property
    def rows(self) -> list[tuple[Operation, int, int, float]]:
        """Operation, slots and constant of every result, in turn."""
        rows = (self.codes, self.left, self.right, self.constants)
        found = zip(*(row.tolist() for row in rows), strict=True)
        return [(Operation(code), left, right, constant) for code, left, right, constant in found]

    @cached_property
    def places(self) -> list[tuple[int, float]]:
        """Slot and fixed number of every output."""
        return list(zip(self.outputs.tolist(), self.fixed.tolist(), strict=True))

    def shifted(self, output: int, constant: float) -> Tape:
        """The tape with a number added to an output."""
        slot = int(self.outputs[output])
        if slot < 0:
            fixed = self.fixed.copy()
            fixed[output] += constant
            return replace(self, fixed=fixed)
        outputs = self.outputs.copy()
        outputs[output] = self.inputs + len(self.codes)
        return replace(
            self,
            codes=np.append(self.codes, int(Operation.SHIFT)),
            left=np.append(self.left, slot),
            right=np.append(self.right, 0),
            constants=np.append(self.constants, constant),
            outputs=outputs,
        )

    @classmethod
    def of(cls, expressions: Sequence[sympy.Expr], inputs: Sequence[sympy.Symbol]) -> Tape:
        """Make the tape of some expressions of the inputs."""
        common, reduced = sympy.cse(list(expressions), symbols=sympy.numbered_symbols("t"))
        writer = _Writer(inputs)
        for symbol, expression in common:
            writer.slots[symbol] = writer.slot(expression)
        outputs, fixed = [], []
        for expression in reduced:
            constant = bool(expression.is_number)
            outputs.append(-1 if constant else writer.slot(expression))
            fixed.append(float(expression) if constant else 0.0)
        rows = writer.rows
        return cls(
            len(inputs),
            np.array([row[0] for row in rows], np.int64),
            np.array([row[1] for row in rows], np.int64),
            np.array([row[2] for row in rows], np.int64),
            np.array([row[3] for row in rows], np.float64),
            np.array(outputs, np.int64),
            np.array(fixed),
        )


class _Writer:
    """Writes expressions as rows: operation, slots, constant. Equal rows are written once."""

    def __init__(self, inputs: Sequence[sympy.Symbol]) -> None:
        self.slots: dict[sympy.Expr, int] = {symbol: i for i, symbol in enumerate(inputs)}
        self.first, self.rows = len(inputs), list[tuple[int, int, int, float]]()
        self._known: dict[tuple[int, int, int, float], int] = {}

    def slot(self, expression: sympy.Expr) -> int:
        """Slot of an expression that depends on the inputs."""
        if expression not in self.slots:
            self.slots[expression] = self._written(expression)
        return self.slots[expression]

    def _written(self, expression: sympy.Expr) -> int:
        if isinstance(expression, sympy.Add | sympy.Mul):
            is_sum = isinstance(expression, sympy.Add)
            numbers = [float(a) for a in expression.args if a.is_number]
            slots = [self.slot(a) for a in expression.args if not a.is_number]
            found = slots[0]
            for other in slots[1:]:
                found = self._row(Operation.SUM if is_sum else Operation.PRODUCT, found, other)
            if not numbers:
                return found
            if is_sum:
                return self._row(Operation.SHIFT, found, constant=sum(numbers))
            return self._row(Operation.SCALE, found, constant=float(np.prod(numbers)))
        argument = self.slot(expression.args[0])
        if isinstance(expression, sympy.Pow):
            if not expression.exp.is_number:
                raise ValueError(f"an exponent of the energy is no number: {expression}")
            return self._power(argument, float(expression.exp))
        codes = {
            sympy.exp: Operation.EXP,
            sympy.log: Operation.LN,
            positive: Operation.POSITIVE,
            step: Operation.STEP,
        }
        return self._row(codes[type(expression)], argument)

    def _power(self, argument: int, exponent: float) -> int:
        """A power, as the product of a whole one and one between −1 and 0, which others share."""
        whole = math.ceil(exponent - WHOLE)
        part = exponent - whole
        found: int | None = None
        if abs(part) > WHOLE:
            found = self._row(Operation.POWER, argument, constant=part)
        if whole < 0:
            argument = self._row(Operation.POWER, argument, constant=-1.0)
        count = abs(whole)
        while count > FACTORS:  # square and multiply
            if count % 2:
                found = self._times(found, argument)
            argument, count = self._row(Operation.PRODUCT, argument, argument), count // 2
        for _ in range(count):
            found = self._times(found, argument)
        assert found is not None  # SymPy knows powers of 0
        return found

    def _times(self, found: int | None, factor: int) -> int:
        return factor if found is None else self._row(Operation.PRODUCT, found, factor)

    def _row(self, code: Operation, left: int, right: int = 0, constant: float = 0.0) -> int:
        row = (int(code), left, right, constant)
        if row not in self._known:
            self._known[row] = self.first + len(self.rows)
            self.rows.append(row)
        return self._known[row]
