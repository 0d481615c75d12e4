"""How kernels are compiled.

All keep what they compile on disk, divide by zero as numpy does and let other threads run. They share these options, since helpers of the
compiler are compiled once per set of options. Compiling is a cost that a person waits for: literal integers among the arguments and
read-only arrays each compile a kernel once more, assignments between array slices bring in the compiler's own text functions.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numba
from numba.core.caching import FunctionCache

OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
"""Of all kernels; nothing here takes them as C functions."""


class Cache(FunctionCache):  # type: ignore[misc, unused-ignore]
    """Kernels on disk, a help and never an obstacle: what a kill or a full disk left of them is compiled anew."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """A kernel that was kept; None if there is none that can be read."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # pickles raise anything
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a kernel, if that can be; a table of contents that cannot be read is begun anew."""
        with suppress(OSError):
            try:
                super().save_overload(sig, data)
            except OSError:
                raise
            except Exception:  # pickles raise anything
                self.flush()
                super().save_overload(sig, data)


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """`numba.njit`; with `cache`, kernels are kept on disk where a folder can be written, and compiled each time where none can."""
    kept = options.pop("cache", False)
    compiler = numba.njit(**options)

    def compiled(function: Callable[..., Any]) -> Any:
        made = compiler(function)
        if kept:
            with suppress(RuntimeError):
                made._cache = Cache(function)
        return made

    return compiled


kernel = njit(**OPTIONS)
"""Kernels called from Python."""

inner_kernel = njit(**OPTIONS, no_cpython_wrapper=True)
"""Kernels called by kernels alone: without a wrapper they compile faster, and a call from Python would crash."""

inlined_kernel = njit(**OPTIONS, no_cpython_wrapper=True, forceinline=True)
"""Inner kernels of a few operations, which would cost more to call than to do."""
