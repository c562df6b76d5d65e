"""RQ2's second question: does a policy come less far where a confounder is like the target?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import fmean

from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.scene import Scene
from vlafuzz.statistics import a12, holm, mann_whitney
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store
from vlafuzz.studies.variants import distinct


@dataclass(frozen=True)
class Similarity:
    """Progress in scenes with a confounder like the first target, and in those with others only.

    Attributes:
        similar, other: numbers of scenes; progress is the mean of each.
        a12: how often progress is larger in a similar scene than in another one; a tie counts half.
        p: Mann and Whitney's, ``adjusted`` for the number of tests by Holm's method. Like ``a12`` it is of
            progress less the mean over the scenes with as many confounders: where there are more, one is
            more often similar.
    """

    task: str
    policy: str
    similar: int
    other: int
    progress_similar: float | None
    progress_other: float | None
    a12: float | None
    p: float | None
    adjusted: float | None = None


def is_similar(scene: Scene, catalogue: Catalogue) -> bool:
    """Whether a confounder is of the first target's kind: its name ends in the same word, such as ``can``."""
    kinds = [catalogue[each.object].spoken.split()[-1] for each in (scene.targets[0], *scene.confounders)]
    return kinds[0] in kinds[1:]


def similarity(store: Store, runs: Sequence[Run], catalogue: Catalogue) -> Similarity:
    """Compare within the scenes with confounders of a policy's runs in a task; in a run all have as many."""
    progress: dict[bool, list[float]] = {True: [], False: []}
    aligned: dict[bool, list[float]] = {True: [], False: []}
    for run in runs:
        trials = [
            trial for trial in distinct(store, run) if trial.outcome.rollouts and trial.scene.confounders
        ]
        usual = fmean(trial.outcome.progress for trial in trials) if trials else 0.0
        for trial in trials:
            group = is_similar(trial.scene, catalogue)
            progress[group].append(trial.outcome.progress)
            aligned[group].append(round(trial.outcome.progress - usual, 9))  # so that ties stay ties
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


def adjusted(found: Sequence[Similarity]) -> list[Similarity]:
    """With p-values for as many tests as there are."""
    tested = [each.p for each in found if each.p is not None]
    values = iter(holm(tested))
    return [each if each.p is None else replace(each, adjusted=next(values)) for each in found]
