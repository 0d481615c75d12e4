"""The decorators of kernels: what they share, and what kernels compiled with them do."""

import numpy as np
import pytest

from morphlet.numerics.compiled import OPTIONS, inlined_kernel, inner_kernel, kernel


@inlined_kernel
def twice(x):
    return 2 * x


@inner_kernel
def inverse(x):
    return 1 / x


@kernel
def inverses_of_doubles(x, out):
    for i in range(len(x)):
        out[i] = inverse(twice(x[i]))


@pytest.mark.parametrize("found", [kernel, inner_kernel, inlined_kernel])
def test_all_kernels_share_their_options(found):
    @found
    def nothing():
        return 0

    assert OPTIONS.items() - {("cache", True)} <= nothing.targetoptions.items()
    assert nothing.targetoptions.get("no_cpython_wrapper", False) == (found is not kernel)
    assert nothing.targetoptions.get("forceinline", False) == (found is inlined_kernel)


def test_kernels_call_kernels_and_divide_by_zero_as_numpy_does():
    out = np.empty(3)
    inverses_of_doubles(np.array([1.0, -4.0, 0.0]), out)
    assert out.tolist() == [0.5, -0.125, np.inf]
    assert len(inverses_of_doubles.signatures) == 1
