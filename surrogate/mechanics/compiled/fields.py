"""Fields at the quadrature points of one load, in loops that Numba compiles.

On small bodies NumPy and PyTorch spend most of the time between their sums, on large ones they read
and write every field once an operation. The compiled functions add to fields in place. They are
compiled at their first call, which takes up to 20 s once for an installation: the results are
kept beside the code, or else in the user's cache. One process at a time writes there: Numba reads
the list of what is kept, adds to it and replaces it, so that of two processes that do it at the
same time one would later find the other's code under its own name. What is kept is of all files of
the mechanics as they are: a compiled function contains those that it calls, from other files.
"""

from __future__ import annotations

import gc
import logging
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from filelock import FileLock
from numba import njit
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.extending import register_jitable
from numpy.typing import NDArray

Array = NDArray[Any]  # of one precision
Function = TypeVar("Function", bound=Callable[..., object])
SOURCES = Path(__file__).parents[1]
logger = logging.getLogger(__name__)
SUMS = {"reassoc", "contract", "arcp", "nsz"}  # in any order; infinite numbers are kept


def compiled(function: Function) -> Function:
    """Compile a function of numbers and arrays at its first call; other threads go on meanwhile."""
    try:
        made: Any = njit(function, cache=True, nogil=True, fastmath=SUMS, error_model="numpy")
    except RuntimeError:  # no folder can be written
        made = njit(function, nogil=True, fastmath=SUMS, error_model="numpy")
    else:
        kept = made._cache._cache_file
        kept._source_stamp = kept._source_stamp, stamp_of(SOURCES)
        _save_one_at_a_time(made._cache)
    _compile_at_one_go(made._compiler)
    return cast(Function, made)


@cache
def stamp_of(folder: Path) -> tuple[tuple[float, int], ...]:
    """Time and size of every Python file in a folder and below it."""
    files = [path.stat() for path in sorted(folder.rglob("*.py"))]
    return tuple((file.st_mtime, file.st_size) for file in files)


def inner(function: Function) -> Function:
    """Let a function be a part of the compiled ones that call it; Python calls it as it is.

    Numba would optimise such a function, write its machine code, and then optimise it once more
    within each caller.
    """
    as_part = register_jitable(pipeline_class=_Parts, fastmath=SUMS, error_model="numpy")
    return as_part(function)


class _Part(JITCodeLibrary):
    """Code that is linked into that of callers; what calls other code is optimised there alone."""

    def _optimize_final_module(self) -> None:
        if not self._linking_libraries:
            super()._optimize_final_module()  # type: ignore[no-untyped-call]

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
        self._finalized = True


class _Parts(CompilerBase):
    """Numba's compiler, as far as code that is linked into that of callers."""

    def define_pipelines(self) -> list[Any]:
        """The usual passes, into a part."""
        state = self.state
        state.flags.no_compile = True
        state.library = _Part(state.targetctx.codegen(), state.func_id.func_qualname)  # type: ignore[no-untyped-call]
        return [DefaultPassBuilder.define_nopython_pipeline(state)]  # type: ignore[no-untyped-call]

    def compile_extra(self, func: object) -> Any:
        """Compile, and let callers find the part by a key that no other has."""
        part: Any = super().compile_extra(func)  # type: ignore[no-untyped-call]
        part = part._replace(entry_point=[].append)
        self.state.targetctx.insert_user_function(part.entry_point, part.fndesc, [part.library])
        return part


def _compile_at_one_go(compiler: Any) -> None:
    """Let Python look for garbage after a compilation: before, that takes a quarter of the time."""
    compile_ = compiler.compile

    def compile_at_one_go(*of: object) -> object:
        say_once()
        collects = gc.isenabled()
        gc.disable()
        try:
            return compile_(*of)
        finally:
            if collects:
                gc.enable()

    compiler.compile = compile_at_one_go


@cache
def say_once() -> None:
    """Say that code is compiled, when a process begins with it."""
    logger.info("code is compiled for this kind of body, once: some seconds up to a minute")


def _save_one_at_a_time(kept: Any) -> None:
    """Let other processes wait while this one adds to what Numba keeps of a function."""
    save, file = kept.save_overload, Path(kept.cache_path) / "compiled.lock"

    def save_alone(signature: object, result: object) -> None:
        with FileLock(file):  # one of its own: a process that was forked may not use its parent's
            save(signature, result)

    kept.save_overload = save_alone


@inner
def cofactors(f: Array, out: Array) -> None:
    """Write cof F: (d, d, n) → same."""
    d = len(f)
    for i in range(d):
        for j in range(d):
            total = out[i, j]
            if d == 2:
                sign, row = total.dtype.type(1 if i == j else -1), f[1 - i, 1 - j]
                for q in range(len(total)):
                    total[q] = sign * row[q]
            else:
                k, n, m, r = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
                a, b, c, e = f[k, m], f[n, r], f[k, r], f[n, m]
                for q in range(len(total)):
                    total[q] = a[q] * b[q] - c[q] * e[q]


@inner
def add_contraction(factor: float, a: Array, b: Array, out: Array) -> None:
    """Add x A : B: (d, d, n_points) twice → (n_points,)."""
    x, d = out.dtype.type(factor), len(a)
    for i in range(d):
        a0, a1, b0, b1 = a[i, 0], a[i, 1], b[i, 0], b[i, 1]
        if d == 3:
            a2, b2 = a[i, 2], b[i, 2]
            for q in range(len(out)):
                out[q] += x * (a0[q] * b0[q] + a1[q] * b1[q] + a2[q] * b2[q])
        else:
            for q in range(len(out)):
                out[q] += x * (a0[q] * b0[q] + a1[q] * b1[q])


@inner
def add_multiple(factor: float, a: Array, out: Array) -> None:
    """Add x A: (n,) → same."""
    x = out.dtype.type(factor)
    for q in range(len(out)):
        out[q] += x * a[q]


@inner
def product_of(a: Array, b: Array) -> float:
    """Sum of products: (n,) twice → number in double precision."""
    total = 0.0
    for q in range(len(a)):
        total += a[q] * b[q]
    return total


@inner
def rough_product(a: Array, b: Array) -> float:
    """The same, added up in the precision of the fields: faster."""
    total = a.dtype.type(0)
    for q in range(len(a)):
        total += a[q] * b[q]
    return float(total)


@inner
def largest(a: Array) -> float:
    """Largest absolute value: (n,) → number."""
    found = 0.0
    for x in a:
        found = max(found, abs(x))
    return found


@inner
def longest(a: Array) -> float:
    """Largest Euclidean norm of a row: (n, d) → number."""
    found = 0.0
    for row in a:
        total = 0.0
        for x in row:
            total += x * x
        found = max(found, total)
    return found**0.5


@inner
def add_weighted_rows(weights: Array, rows: Array, out: Array) -> None:
    """Add weighted rows of a matrix; many weights may be zero: (k,), (k, n_out) → (n_out,)."""
    for k in range(len(weights)):
        if weights[k] != 0:
            for i in range(len(out)):
                out[i] += weights[k] * rows[k, i]
