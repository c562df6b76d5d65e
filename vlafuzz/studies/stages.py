"""Stage success: the share of scenes in which a policy reaches each stage of a task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean

from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.statistics import Share, wilson
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store
from vlafuzz.studies import published
from vlafuzz.studies.variants import distinct
from vlafuzz.tasks.tabletop import TASKS


@dataclass(frozen=True)
class Reached(Share):
    """The share of scenes that reached a stage."""

    stage: str = ""


@dataclass(frozen=True, kw_only=True)
class Standing:
    """The counts of one run.

    Attributes:
        confounders: their number in every scene; None where it varies.
        judged: distinct scenes that passed or failed; ``invalid`` and ``errors`` are left out of all shares.
        progress: mean over the judged scenes, in [0, 1].
        stopped: whether the run ended before it had all scenes.
    """

    task: str
    policy: str
    confounders: int | None
    judged: int
    invalid: int
    errors: int
    progress: float | None
    stopped: bool
    stages: tuple[Reached, ...]


@dataclass(frozen=True)
class Published:
    """The paper's success in a task: of other policies on another robot in another simulator.

    Attributes:
        mean, as_well: success over seven policies; for one task the paper prints two values.
        policies: success by policy, counted in the authors' data.
    """

    task: str
    mean: float
    as_well: float | None
    policies: dict[str, float]


def standing(store: Store, run: Run, confounders: int | None = None) -> Standing:
    """Count a run, each scene once; a scene reaches a stage when all of its rollouts do."""
    trials = distinct(store, run)
    judged = [trial.outcome for trial in trials if trial.outcome.rollouts]
    verdicts = [trial.outcome.verdict for trial in trials]
    return Standing(
        task=run.manifest.task,
        policy=run.manifest.policy,
        confounders=confounders,
        judged=len(judged),
        invalid=verdicts.count(Verdict.INVALID),
        errors=verdicts.count(Verdict.ERROR),
        progress=fmean(outcome.progress for outcome in judged) if judged else None,
        stopped=run.status != "finished",
        stages=reached(run.manifest.task, judged),
    )


def in_paper(task: str) -> Published:
    """The paper's figures of RQ1 for a task."""
    mean = next(row for row in published.success() if (row.task, row.policy) == (task, "mean"))
    shares = {row.policy: row.passed / row.of for row in published.passed() if row.task == task}
    return Published(task, mean.share, mean.as_well, shares)


def reached(task: str, judged: Sequence[Outcome]) -> tuple[Reached, ...]:
    """The share of scenes that reached each stage of a task in all of their rollouts."""
    return tuple(_reached(stage, judged) for stage in TASKS[task].stage_names)


def _reached(stage: str, judged: Sequence[Outcome]) -> Reached:
    count = sum(
        all(stage in rollout.reached or rollout.success_once for rollout in outcome.rollouts)
        for outcome in judged
    )
    return Reached(count, len(judged), *wilson(count, len(judged)), stage=stage)
