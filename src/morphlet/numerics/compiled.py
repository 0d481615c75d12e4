"""How kernels are compiled.

All keep what they compile on disk, divide by zero as numpy does and let other threads run. They share these options, since helpers of the
compiler are compiled once per set of options. Compiling is a cost that a person waits for: literal integers among the arguments and
read-only arrays each compile a kernel once more, assignments between array slices bring in the compiler's own text functions.
"""

from typing import Any

from numba import njit

OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
"""Of all kernels; nothing here takes them as C functions."""

kernel = njit(**OPTIONS)
"""Kernels called from Python."""

inner_kernel = njit(**OPTIONS, no_cpython_wrapper=True)
"""Kernels called by kernels alone: without a wrapper they compile faster, and a call from Python would crash."""

inlined_kernel = njit(**OPTIONS, no_cpython_wrapper=True, forceinline=True)
"""Inner kernels of a few operations, which would cost more to call than to do."""
