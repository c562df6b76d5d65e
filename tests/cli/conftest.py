"""What tests of commands share."""

import pytest

from vlafuzz.search.causes import draws


@pytest.fixture(autouse=True)
def _few_random_scenes(monkeypatch) -> None:
    """Strategy `causes` draws 600 random scenes for its shares, 2 to 15 s a run; commands do with fewer."""
    monkeypatch.setattr(draws, "SAMPLE", 60)
