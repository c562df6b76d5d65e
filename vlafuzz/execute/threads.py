"""One thread for each process that is started from now on: workers are many, and threads change last bits."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

_SINGLE = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "LP_NUM_THREADS": "0"}


@contextmanager
def single_threaded() -> Iterator[None]:
    """For as long as the block lasts. Libraries read it when they are imported, before any code of ours."""
    before = {name: os.environ.get(name) for name in _SINGLE}
    os.environ.update(_SINGLE)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
