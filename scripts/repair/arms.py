"""Arms: which demonstrations a policy is trained with; scenes of every kind come from the same runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal, get_args

from vlafuzz.integrations.selection import Wanted, Which, around, at_random, failures_of_store
from vlafuzz.store.store import Store

# Random scenes, failing ones, minimal ones with their passing counterparts; or failing ones, of which the
# policy begins most, until the expert takes over.
Kind = Literal["random", "failed", "minimal", "taken-over"]
KINDS: tuple[Kind, ...] = get_args(Kind)

# The share of each kind, of a number of demonstrations that is the same for all but ``random-twice``.
ARMS: dict[str, Mapping[Kind, float]] = {
    "random": {"random": 1.0},
    "failed": {"failed": 1.0},
    "minimal": {"minimal": 1.0},
    "mixed": {"failed": 0.5, "random": 0.5},
    "taken-over": {"taken-over": 1.0},
    "random-twice": {"random": 2.0},
}


def wanted(source: Path, kind: Kind) -> Iterator[Wanted]:
    """Scenes of one kind without end, of the runs of a store; failing ones come again, slightly jittered."""
    which: Which = "minimal" if kind == "minimal" else "failed"
    with Store.open(source) as store:
        failures = failures_of_store(store, None, which)
    return at_random(source, failures) if kind == "random" else around(failures)
