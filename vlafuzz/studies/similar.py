"""RQ2's second question: does a policy make less progress when a confounder resembles the target?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.scene import Scene
from vlafuzz.statistics import a12, mann_whitney
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store
from vlafuzz.studies.sheet import Tested
from vlafuzz.studies.variants import distinct


@dataclass(frozen=True, kw_only=True)
class Similarity(Tested):
    """Progress in scenes with a confounder like the first target, and in scenes with other confounders only.

    Attributes:
        similar, other: numbers of scenes; progress is the mean of each.
        a12: probability that progress is larger in a similar scene than in another one; a tie counts half.
        p: Mann and Whitney's, ``adjusted`` for the number of tests by Holm's method. Like ``a12`` it compares
            progress minus the mean over the scenes with as many confounders, as with more of them one is
            more likely to be similar.
    """

    task: str
    policy: str
    similar: int
    other: int
    progress_similar: float | None
    progress_other: float | None
    a12: float | None


def is_similar(scene: Scene, catalogue: Catalogue) -> bool:
    """Whether a confounder is of the first target's kind: its name ends in the same word, such as ``can``."""
    placements = (scene.targets[0], *scene.confounders)
    target, *others = (catalogue[placement.object].spoken.split()[-1] for placement in placements)
    return target in others


def similarity(store: Store, runs: Sequence[Run], catalogue: Catalogue) -> Similarity:
    """Compare scenes with confounders in runs of one policy and task, each with a fixed number of them."""
    progress: dict[bool, list[float]] = {True: [], False: []}
    aligned: dict[bool, list[float]] = {True: [], False: []}
    for run in runs:
        trials = [
            trial for trial in distinct(store, run) if trial.outcome.rollouts and trial.scene.confounders
        ]
        mean = fmean(trial.outcome.progress for trial in trials) if trials else 0.0
        for trial in trials:
            group = is_similar(trial.scene, catalogue)
            progress[group].append(trial.outcome.progress)
            aligned[group].append(round(trial.outcome.progress - mean, 9))  # so that ties stay ties
    similar, other = progress[True], progress[False]
    both = bool(similar and other)
    return Similarity(
        task=runs[0].manifest.task,
        policy=runs[0].manifest.policy,
        similar=len(similar),
        other=len(other),
        progress_similar=fmean(similar) if similar else None,
        progress_other=fmean(other) if other else None,
        a12=a12(aligned[True], aligned[False]) if both else None,
        p=mann_whitney(aligned[True], aligned[False]) if both else None,
    )
