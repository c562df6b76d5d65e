"""Stores of findings."""

from pathlib import Path

import pytest

from tests.failures.triage.runners import fill
from vlafuzz.store.store import Store


@pytest.fixture
def store(tmp_path: Path):
    """``store(scenes)``: a store in which they failed, open to be written."""
    with Store.open(tmp_path / "a.db", "write") as opened:
        yield lambda failing, cells=(): fill(opened, failing, cells)
