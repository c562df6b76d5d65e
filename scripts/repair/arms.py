"""Arms: which demonstrations a policy is trained with; scenes of every kind come from the same runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal, get_args

from vlafuzz.common.assets import corpus_dir
from vlafuzz.exports.selection import FailingScene, WantedScene, around, at_random, failures_of
from vlafuzz.failures.corpus.folder import read_corpus

# Random scenes; failing ones; certified minimal ones with their passing counterparts; or failing ones that
# the policy begins, mostly, until the expert takes over.
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


def wanted(store: Path, task: str, kind: Kind) -> Iterator[WantedScene]:
    """Scenes of one kind without end, of the runs of a store; failing ones come again, slightly jittered.

    Minimal scenes are those of the shipped corpus, which took many more rollouts than a run.
    """
    if kind == "minimal":
        folder = corpus_dir() / f"mini-{task}"
        corpus = read_corpus(folder)
        scenes = [(scene, case) for case in corpus.cases for scene in (case.scene, *case.counterparts.values())]
        return around(folder, [FailingScene(scene, corpus.runs[case.run]) for scene, case in scenes])
    failures = failures_of(store)
    return at_random(store, failures) if kind == "random" else around(store, failures)
