"""One thread in the numeric libraries: same bits on every machine, and quicker on busy ones."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any


def one_thread() -> AbstractContextManager[Any]:
    """A context in which BLAS and LAPACK use one thread.

    The matrices of one patch are too small to gain from more, and sums in another order would
    end in other bits.
    """
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[Any] = threadpool_limits(limits=1, user_api="blas")
    return limits
