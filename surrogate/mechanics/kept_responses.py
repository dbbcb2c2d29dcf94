r"""Responses of a large linear map that are kept: a load made of them costs a sum, not a solve.

These are columns, the responses to single inputs, which are found when they are first asked for,
and the responses to uniform body forces: a load f is taken apart as

.. math:: f = \sum_i b_i \, m_i + \sum_k f_k \, e_k

with the nodal forces :math:`m_i` of a unit body force along each axis and few inputs k.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

KEPT = 2**31  # bytes of all columns that may be kept
LOADED = 30  # inputs of one load for which columns are solved for
PROBES = 101  # inputs that tell whether a load holds a body force
ROUNDING = 2.0**-20  # of forces in single precision, relative
AT_ONCE = 64  # columns that are solved for together

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Numbers = NDArray[np.int64]


class KeptResponses:
    """Responses of a linear map from forces to displacements, in single precision.

    Parameters
    ----------
    respond : callable
        The map: (N, size) → (N, size), in double precision.
    size : int
        Number of inputs, and of outputs.
    units : sequence of (array of int (n,), array (n,))
        Inputs and values of loads that other loads may be multiples of, such as unit body forces;
        no two of them act on one input.

    Attributes
    ----------
    most : int
        Number of columns that are kept at most. Where there is no room, they are forgotten.
    """

    def __init__(
        self,
        respond: Callable[[Array], NDArray[Any]],
        size: int,
        units: Sequence[tuple[Numbers, Array]] = (),
    ) -> None:
        self.respond, self.size, self.units = respond, size, tuple(units)
        self.most = min(size, max(KEPT // (4 * size), LOADED))
        self._columns: Single | None = None
        self._places = np.full(size, -1)  # of every column that is kept
        self._kept = 0
        self._of_units: Single | None = None
        self._lock = Lock()
        self._probes = [i[:: max(1, len(i) // PROBES)] for i in (np.arange(len(u)) for u, _ in units)]

    def __reduce__(self) -> tuple[Any, ...]:
        return KeptResponses, (self.respond, self.size, self.units)  # without what is kept

    def __getitem__(self, numbers: Numbers) -> Single:
        """Columns of some different inputs, `most` at most, as rows: (n, size)."""
        with self._lock:
            missing = numbers[self._places[numbers] < 0]
            if len(missing):
                if self._columns is None:
                    self._columns = np.empty((self.most, self.size), dtype=np.float32)
                if self._kept + len(missing) > self.most:
                    self._places[:], self._kept, missing = -1, 0, numbers
                for start in range(0, len(missing), AT_ONCE):
                    some = missing[start : start + AT_ONCE]
                    unit = np.zeros((len(some), self.size))
                    unit[np.arange(len(some)), some] = 1
                    end = self._kept + len(some)
                    self._columns[self._kept : end] = self.respond(unit)
                    self._places[some], self._kept = np.arange(self._kept, end), end
            if self._columns is None:
                return np.empty((0, self.size), np.float32)
            return self._columns[self._places[numbers]]

    def holds(self, numbers: Numbers) -> bool:
        """Tell whether the columns of some inputs are there."""
        return bool((self._places[numbers] >= 0).all())

    def answer(self, load: Single, new: bool = True) -> Single | None:
        """Respond to one load, (size,) → same, by a sum; None if it is not made of a few parts.

        Parameters
        ----------
        load : array, (size,)
        new : bool
            Columns that are not there may be solved for, if there are few.
        """
        shares, rest = self._taken_apart(load)
        loaded = rest.nonzero()[0]
        there = self.holds(loaded)
        if len(loaded) > self.most or not (there or (new and len(loaded) <= LOADED)):
            return None
        found: Single = rest[loaded] @ self[loaded]
        if shares.any():
            found += shares @ self._unit_responses()
        return found

    def _taken_apart(self, load: Single) -> tuple[Single, Single]:
        """Share of every unit load, and the rest."""
        shares, rest = np.zeros(len(self.units), load.dtype), load
        for number, ((inputs, values), probes) in enumerate(
            zip(self.units, self._probes, strict=True)
        ):
            of_probes = load[inputs[probes]] / values[probes]
            share = np.median(of_probes)
            near = np.abs(of_probes - share) <= ROUNDING * abs(share)
            if share == 0 or 2 * np.count_nonzero(near) <= len(probes):
                continue
            if rest is load:
                rest = load.copy()
            part, whole = load[inputs], share * values
            rest[inputs] = np.where(np.abs(part - whole) <= ROUNDING * np.abs(whole), 0, part - whole)
            shares[number] = share
        return shares, rest

    def _unit_responses(self) -> Single:
        """Responses to the unit loads, found once: (n, size)."""
        with self._lock:
            if self._of_units is None:
                loads = np.zeros((len(self.units), self.size))
                for load, (inputs, values) in zip(loads, self.units, strict=True):
                    load[inputs] = values
                self._of_units = self.respond(loads).astype(np.float32)
            return self._of_units
