r"""Responses of a large linear map that are kept: a load made of them costs a sum, not a solve.

These are columns, the responses to single inputs, which are found when they are first asked for,
and the responses to uniform body forces and pressures: a load f is taken apart as

.. math:: f = \sum_i b_i \, m_i + \sum_k f_k \, e_k

with the nodal forces :math:`m_i` of a unit body force along each axis, and of a unit pressure on
each surface of the undeformed body, and few inputs k.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from shared_schema.common.errors import InputError

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
        Inputs and values of loads that other loads may be multiples of, such as unit body forces.
        Multiples of the first ones are taken out before those of others.

    Attributes
    ----------
    most : int
        Number of columns that are kept at most. Where there is no room, those are forgotten that
        `keep` has not been asked for.
    """

    def __init__(
        self,
        respond: Callable[[NDArray[Any]], NDArray[Any]],
        size: int,
        units: Sequence[tuple[Numbers, Array]] = (),
    ) -> None:
        self.respond, self.size, self.units = respond, size, tuple(units)
        self.most = min(size, max(KEPT // (4 * size), LOADED))
        self._columns: Single | None = None
        self._places = np.full(size, -1)  # of every column that is kept
        self._kept, self._lasting = 0, 0
        self._of_units: Single | None = None
        self._lock = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        return KeptResponses, (self.respond, self.size, self.units)  # without what is kept

    def sum_of(self, numbers: Numbers, weights: Single) -> Single:
        """Sum of the columns of some different inputs, `most` at most, times weights: (size,)."""
        with self._lock:
            missing = numbers[self._places[numbers] < 0]
            if self._kept + len(missing) > self.most:
                self._places[self._places >= self._lasting], self._kept = -1, self._lasting
                missing = numbers[self._places[numbers] < 0]
            if self._kept + len(missing) > self.most:
                parts = zip(_parts(numbers), _parts(weights), strict=True)
                found = sum(w @ self._solved(some) for some, w in parts)
                return np.asarray(found, np.float32)
            for some in _parts(missing):
                self._put(some, self._solved(some))
            ends = [0, len(numbers)]  # a sparse row times the columns, which copies none of them
            row = csr_array((weights, self._places[numbers], ends), shape=(1, self.most))
            return np.asarray((row @ self._room())[0])

    def keep(self, numbers: Numbers, columns: Single | None = None) -> Single:
        """Keep the columns of some different inputs for good, in place of all others: (n, size).

        Parameters
        ----------
        numbers : array of int, (n,)
        columns : array, (n, size), optional
            If they are known; otherwise they are solved for.

        Raises
        ------
        InputError
            If they take more memory than may be kept.
        """
        if len(numbers) > self.most:
            taken = 4 * len(numbers) * self.size / 1e9
            raise InputError(
                f"{len(numbers)} columns take {taken:.2g} GB, expected {KEPT / 1e9:.2g} GB at most"
            )
        with self._lock:
            self._places[:], self._kept, self._lasting = -1, 0, 0
            if columns is not None:
                self._put(numbers, columns)
            else:
                for part in _parts(numbers):
                    self._put(part, self._solved(part))
            self._lasting = self._kept
            return self._room()[: self._kept]

    def _room(self) -> Single:
        """Where columns are kept, (most, size)."""
        if self._columns is None:
            self._columns = np.empty((self.most, self.size), dtype=np.float32)
        return self._columns

    def _put(self, numbers: Numbers, columns: NDArray[Any]) -> None:
        end = self._kept + len(numbers)
        self._room()[self._kept : end] = columns
        self._places[numbers], self._kept = np.arange(self._kept, end), end

    def _solved(self, numbers: Numbers) -> NDArray[Any]:
        unit = np.zeros((len(numbers), self.size))
        unit[np.arange(len(numbers)), numbers] = 1
        return self.respond(unit)

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
        there = bool((self._places[loaded] >= 0).all())
        if len(loaded) > self.most or not (there or (new and len(loaded) <= LOADED)):
            return None
        found = self.sum_of(loaded, rest[loaded])
        if shares.any():
            found += shares @ self._unit_responses()
        return found

    def answers(self, loads: Single, new: bool = True) -> Single:
        """Respond to loads as `answer`, or else all at once by the map: (N, size) → same."""
        found, left = np.empty_like(loads), []
        for number, load in enumerate(loads):
            answer = self.answer(load, new)
            if answer is None:
                left.append(number)
            else:
                found[number] = answer
        if left:
            found[left] = self.respond(loads[left])
        return found

    def _taken_apart(self, load: Single) -> tuple[Single, Single]:
        """Share of every unit load, and the rest."""
        shares, rest = np.zeros(len(self.units), load.dtype), load
        for number, (inputs, values) in enumerate(self.units):
            step = max(1, len(inputs) // PROBES)
            probes = rest[inputs[::step]]
            if 2 * np.count_nonzero(probes) <= len(probes):
                continue
            of_probes = probes / values[::step]
            share = np.median(of_probes)
            near = np.abs(of_probes - share) <= ROUNDING * abs(share)
            if 2 * np.count_nonzero(near) <= len(near):
                continue
            if rest is load:
                rest = load.copy()
            whole = share * values
            part = rest[inputs] - whole
            rest[inputs] = np.where(np.abs(part) <= ROUNDING * np.abs(whole), 0, part)
            rest[np.abs(rest) <= ROUNDING**2 * np.abs(whole).max()] = 0  # where a unit has nearly 0
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


def _parts(values: NDArray[Any]) -> list[NDArray[Any]]:
    """Values of inputs that are solved for together."""
    return [values[start : start + AT_ONCE] for start in range(0, len(values), AT_ONCE)]
