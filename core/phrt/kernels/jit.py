"""How kernels are compiled: without the GIL, cached on disk, with reassociation allowed but infinities and NaN kept."""

from __future__ import annotations

import numba

# 'ninf' and 'nnan' stay out: a miss is t = +inf, and an unlimited shadow ray has t_max = +inf.
FASTMATH = {"nsz", "arcp", "contract", "afn", "reassoc"}

kernel = numba.njit(nogil=True, cache=True, fastmath=FASTMATH, error_model="numpy")
"""A function over arrays, called from Python."""

inlined = numba.njit(nogil=True, fastmath=FASTMATH, error_model="numpy", inline="always")
"""A scalar function that is pasted into its caller: for the one call that every hit makes; it costs compile time."""

device = numba.njit(nogil=True, fastmath=FASTMATH, error_model="numpy", inline="never")
"""A scalar function, called from kernels; LLVM inlines it where that pays."""
