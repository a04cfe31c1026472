"""LAPACK routines that kernels can call, without an allocation and without Python.

SciPy publishes the addresses of its LAPACK (``scipy.linalg.cython_lapack``). An address is good for one process only,
so it must never become part of machine code that Numba keeps on disk. Each routine therefore gets a name of our own in
LLVM's table of symbols when this module is imported, and kernels refer to the name: cached machine code holds an open
reference that the loader fills in anew in every process. Whoever calls such a kernel has imported this module, for the
kernel's own module does.

Every argument of LAPACK is an address, here an integer made by :func:`address`. Whole numbers stand in int64 arrays:
on a little-endian machine the routine reads the same value whether its INTEGER has four bytes or eight.
"""

from __future__ import annotations

import sys
from typing import Any

from numba import types
from numba.core.codegen import ll  # the llvmlite that Numba compiles with
from numba.extending import get_cython_function_address

from aquaquad_envs.compilation import kernel

if sys.byteorder != "little":  # pragma: no cover
    raise ImportError("LAPACK in kernels needs a little-endian machine.")


def _routine(name: str, arguments: int) -> Any:
    symbol = f"aquaquad_lapack_{name}"
    ll.add_symbol(symbol, get_cython_function_address("scipy.linalg.cython_lapack", name))
    return types.ExternalFunction(symbol, types.void(*[types.intp] * arguments))


#: QR factors: (m, n, a, lda, tau, work, lwork, info).
dgeqrf = _routine("dgeqrf", 8)
#: Singular values and vectors: (jobu, jobvt, m, n, a, lda, s, u, ldu, vt, ldvt, work, lwork, info).
dgesvd = _routine("dgesvd", 14)
#: Least squares by the SVD: (m, n, nrhs, a, lda, b, ldb, s, rcond, rank, work, lwork, iwork, info).
dgelsd = _routine("dgelsd", 14)


@kernel
def address(array):
    """Where the first element of ``array`` is."""
    return array.ctypes.data
