"""What all tests share: one thread a process, and no render tests without a renderer."""

import os

# Before anything loads torch or a Vulkan driver. pytest-xdist runs several of these processes.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("LP_NUM_THREADS", "0")

import functools

import pytest

from vlafuzz import renderer

probe = functools.cache(renderer.probe)


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("render") and not probe().works:
        pytest.skip(str(probe()))
