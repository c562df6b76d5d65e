"""What tests of commands share."""

from pathlib import Path

import pytest

from tests.doubles import ended, stored
from tests.failures.triage.planted import TILTED, Planted
from tests.report.stores import MANIFEST


@pytest.fixture(scope="module", autouse=True)
def _few_random_scenes(few_random_scenes: None) -> None:
    """In all tests of commands."""


@pytest.fixture
def tilted(tmp_path: Path, monkeypatch) -> Path:
    """A store, ``a.db`` here, with three findings of a policy that fails where the camera is tilted."""
    monkeypatch.chdir(tmp_path)
    failing = (ended(Planted([TILTED]).finding(seed), proposal=seed, cell=f"{seed}") for seed in range(3))
    return stored(tmp_path / "a.db", *failing, about=MANIFEST)
