"""What tests of commands share."""

from pathlib import Path

import pytest

from tests.doubles import ClosedForm
from vlafuzz.campaign import launch
from vlafuzz.search.causes import draws


@pytest.fixture(autouse=True)
def _few_random_scenes(monkeypatch) -> None:
    """Strategy `causes` draws 200 random scenes and more for its shares, 1 to 5 s a run; commands do with fewer."""
    monkeypatch.setattr(draws, "FIRST", 60)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    """Runs happen in a folder of their own, without a simulator: in the dark, policies fail."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(launch, "make_evaluator", lambda manifest, _: ClosedForm(manifest.repeats))
    return tmp_path
