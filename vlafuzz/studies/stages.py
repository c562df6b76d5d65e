"""How far a subject comes: the share of scenes in which it reaches each stage of a task."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import fmean

from vlafuzz.corpus.records import Run, Trial
from vlafuzz.corpus.store import Corpus
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.scoring import wilson
from vlafuzz.studies import published
from vlafuzz.tasks.tabletop import TASKS


@dataclass(frozen=True)
class Reached:
    """``count`` of ``of`` scenes reached a stage; ``low`` and ``high`` are Wilson's interval, 95 %."""

    stage: str
    count: int
    of: int
    share: float
    low: float
    high: float


@dataclass(frozen=True)
class Standing:
    """One run, counted.

    Attributes:
        confounders: how many there are in every scene; None where that varies.
        judged: distinct scenes that passed or failed; ``invalid`` and ``errors`` are left out of all shares.
        progress: mean over the judged scenes, in [0, 1].
        stopped: whether it ended before it had all scenes.
    """

    task: str
    subject: str
    confounders: int | None
    judged: int
    invalid: int
    errors: int
    progress: float | None
    stopped: bool
    stages: tuple[Reached, ...]


@dataclass(frozen=True)
class Published:
    """What the paper has of a task: other subjects on another robot in another simulator.

    Attributes:
        mean, as_well: success over seven subjects, printed in two ways for one task.
        subjects: success of each, counted in the authors' data.
    """

    task: str
    mean: float
    as_well: float | None
    subjects: dict[str, float]


def standing(corpus: Corpus, run: Run, confounders: int | None = None) -> Standing:
    """Count a run, each scene once: a stage counts where all rollouts of the scene reached it."""
    trials = distinct(corpus, run)
    judged = [trial.outcome for trial in trials if trial.outcome.rollouts]
    verdicts = [trial.outcome.verdict for trial in trials]
    return Standing(
        task=run.manifest.task,
        subject=run.manifest.subject,
        confounders=confounders,
        judged=len(judged),
        invalid=verdicts.count(Verdict.INVALID),
        errors=verdicts.count(Verdict.ERROR),
        progress=fmean(outcome.progress for outcome in judged) if judged else None,
        stopped=run.status != "finished",
        stages=tuple(_reached(stage, judged) for stage in TASKS[run.manifest.task].stage_names),
    )


def distinct(corpus: Corpus, run: Run) -> list[Trial]:
    """The trials of a run, without those that were answered with the outcome of another one."""
    return [trial for trial in corpus.trials(run.id) if not trial.duplicate]


def in_paper(task: str) -> Published:
    """The paper's figures of RQ1 for a task."""
    mean = next(row for row in published.success() if (row.task, row.subject) == (task, "mean"))
    shares = {row.subject: row.passed / row.of for row in published.passed() if row.task == task}
    return Published(task, mean.share, mean.as_well, shares)


def _reached(stage: str, judged: list[Outcome]) -> Reached:
    count = sum(
        all(stage in rollout.reached or rollout.success_once for rollout in outcome.rollouts)
        for outcome in judged
    )
    low, high = wilson(count, len(judged))
    return Reached(stage, count, len(judged), count / len(judged) if judged else 0.0, low, high)
