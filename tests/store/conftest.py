"""A store that is open to be written, and where it is."""

from pathlib import Path

import pytest

from vlafuzz.store.store import Store


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "runs" / "a.db"


@pytest.fixture
def store(path: Path):
    with Store.open(path, "write") as opened:
        yield opened
