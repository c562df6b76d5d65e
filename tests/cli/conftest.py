"""What tests of commands share."""

from pathlib import Path

import pytest

from tests.doubles import ClosedForm, ended, failed, manifest
from tests.failures.triage.planted import CONDITIONS, Planted
from vlafuzz.campaign import launch
from vlafuzz.failures import regions
from vlafuzz.search.causes import draws
from vlafuzz.store.store import Store


@pytest.fixture(autouse=True)
def _few_random_scenes(monkeypatch) -> None:
    """Shares of causes rest on hundreds of random scenes, which take seconds; tests of commands do with fewer."""
    monkeypatch.setattr(draws, "FIRST", 60)
    monkeypatch.setattr(regions, "DRAWN", 100)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    """Runs happen in a folder of their own, without a simulator: in the dark, policies fail."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(launch, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
    return tmp_path


@pytest.fixture
def tilted(tmp_path: Path, monkeypatch) -> Path:
    """A store, ``a.db`` here, with three findings of a policy that fails where the camera is tilted."""
    monkeypatch.chdir(tmp_path)
    fails = CONDITIONS["camera-orientation"][0]
    with Store.open(tmp_path / "a.db", "write") as opened:
        run = opened.begin(manifest())
        for seed in range(3):
            opened.add(run, ended(Planted([fails]).finding(seed), failed(), seed, cell=f"{seed}"))
    return tmp_path / "a.db"
