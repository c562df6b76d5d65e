"""What tests of commands share."""

from pathlib import Path

import pytest

from tests.doubles import ended, stored
from tests.failures.triage.planted import TILTED, Planted
from tests.report.stores import MANIFEST
from vlafuzz.failures import regions
from vlafuzz.search.causes import draws


@pytest.fixture(autouse=True)
def _few_random_scenes(monkeypatch) -> None:
    """Shares of causes rest on hundreds of random scenes, which take seconds; tests of commands do with fewer."""
    monkeypatch.setattr(draws, "FIRST", 60)
    monkeypatch.setattr(regions, "DRAWN", 100)


@pytest.fixture
def tilted(tmp_path: Path, monkeypatch) -> Path:
    """A store, ``a.db`` here, with three findings of a policy that fails where the camera is tilted."""
    monkeypatch.chdir(tmp_path)
    failing = (ended(Planted([TILTED]).finding(seed), proposal=seed, cell=f"{seed}") for seed in range(3))
    return stored(tmp_path / "a.db", *failing, about=MANIFEST)
