"""RQ1 and RQ2: the share of scenes in which a policy reaches each stage of a task."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

from vlafuzz.common.statistics import Share, a12, mann_whitney
from vlafuzz.common.text import Row, percent, plural
from vlafuzz.lab.plots import coloured, save
from vlafuzz.lab.studies import published
from vlafuzz.lab.studies.runner import distinct
from vlafuzz.lab.studies.sheet import BESIDE, MARK, Series, StudyResult, Tested, adjusted, bars, chance, share_panels
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.report.view import Table
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS


@dataclass(frozen=True)
class Reached(Share):
    """The share of scenes that reached a stage."""

    stage: str = ""


@dataclass(frozen=True, kw_only=True)
class Standing:
    """The counts of one run.

    Attributes:
        confounders: their number in every scene; None where it varies.
        judged: distinct scenes that passed or failed; ``invalid`` and ``errors`` are left out of all shares. progress:
        mean over the judged scenes, in [0, 1].
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
    """The paper's success in a task: the mean of seven policies, and of each as in the authors' data.

    For one task the paper prints a second mean, ``as_well``.
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
        progress=_mean([outcome.progress for outcome in judged]),
        stopped=run.status != "finished",
        stages=reached(run.manifest.task, judged),
    )


def in_paper(task: str) -> Published:
    """The paper's figures of RQ1 for a task."""
    mean = next(row for row in published.rows(published.Success) if (row.task, row.policy) == (task, "mean"))
    shares = {row.policy: row.passed / row.of for row in published.rows(published.Passed) if row.task == task}
    return Published(task, mean.share, mean.as_well, shares)


def reached(task: str, judged: Sequence[Outcome]) -> tuple[Reached, ...]:
    """The share of scenes that reached each stage of a task in all of their rollouts."""
    stages = []
    for stage in TASKS[task].stage_names:
        came = (
            all(stage in rollout.reached or rollout.success_once for rollout in outcome.rollouts) for outcome in judged
        )
        share = Share.of_counts(sum(came), len(judged))
        stages.append(Reached(share.count, share.of, share.low, share.high, stage=stage))
    return tuple(stages)


@dataclass(frozen=True, kw_only=True)
class Similarity(Tested):
    """Progress in scenes with a confounder like the first target, and in scenes with other confounders only.

    Attributes:
        similar, other: numbers of scenes; progress is the mean of each.
        a12: probability that progress is larger in a similar scene than in another one; a tie counts half. p: Mann and
        Whitney's, ``adjusted`` for the number of tests by Holm's method. Like ``a12`` it compares
            progress minus the mean over the scenes with as many confounders, as with more of them one is more likely to
            be similar.
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


def similarities(store: Store, runs: Sequence[Run], catalogue: Catalogue) -> list[Similarity]:
    """Compare scenes with confounders in the runs of each policy and task, each of a fixed number of them."""
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.manifest.policy, run.manifest.task), []).append(run)
    return adjusted([_similarity(store, group, catalogue) for group in groups.values()])


def _similarity(store: Store, runs: Sequence[Run], catalogue: Catalogue) -> Similarity:
    progress: dict[bool, list[float]] = {True: [], False: []}
    aligned: dict[bool, list[float]] = {True: [], False: []}
    for run in runs:
        trials = [one for one in distinct(store, run) if one.outcome.rollouts and one.scene.confounders]
        mean = _mean([trial.outcome.progress for trial in trials]) or 0.0
        for trial in trials:
            group = is_similar(trial.scene, catalogue)
            progress[group].append(trial.outcome.progress)
            aligned[group].append(round(trial.outcome.progress - mean, 9))  # so that ties stay ties
    both = bool(progress[True] and progress[False])
    return Similarity(
        task=runs[0].manifest.task,
        policy=runs[0].manifest.policy,
        similar=len(progress[True]),
        other=len(progress[False]),
        progress_similar=_mean(progress[True]),
        progress_other=_mean(progress[False]),
        a12=a12(aligned[True], aligned[False]) if both else None,
        p=mann_whitney(aligned[True], aligned[False]) if both else None,
    )


def _mean(values: Sequence[float]) -> float | None:
    return fmean(values) if values else None


_NOTE = "Shares are of the scenes that were judged, with Wilson's 95 % interval."
_SIMILAR = "Similar: a confounder's name ends in the same word as the target's, such as can."
_FAIR = "scenes are first checked for fairness, with its distance, and errors do not count as failures."
_DIFFERS = {
    "rq1": f"it has 1000 scenes per task; here {_FAIR}",
    "rq2": f"it has 100 scenes per task and number, and does not define similar; here {_FAIR}",
}


@dataclass(frozen=True)
class StageResult(StudyResult):
    """The result of RQ1, with the paper's figures, or of RQ2, with similarity of confounders."""

    standings: list[Standing]
    published: list[Published]
    similar: list[Similarity]

    def sheet(self) -> tuple[list[Table], list[str]]:
        """One table per task."""
        tasks = dict.fromkeys(standing.task for standing in self.standings)
        tables = [Table(task, [_row(row) for row in self.standings if row.task == task]) for task in tasks]
        notes = [_NOTE]
        if stopped := [f"{row.task}, {_label(row)}" for row in self.standings if row.stopped]:
            notes.append(f"Ended before all scenes: {'; '.join(stopped)}.")
        if self.published:
            tables.append(Table("The paper's success", [_paper_row(paper) for paper in self.published]))
            notes.append(BESIDE)
        if self.similar:
            tables.append(Table("Confounders like the target", [_similar_row(row) for row in self.similar]))
            notes.append(_SIMILAR)
        return tables, self.noted(_DIFFERS[self.study], *notes)

    def draw(self, path: Path) -> None:
        """Bars per stage, a panel per task, in RQ2 per policy, too; the paper's mean success as a mark."""
        panels: dict[str, list[Standing]] = {}
        for standing in self.standings:
            name = standing.task if standing.confounders is None else f"{standing.task}, {standing.policy}"
            panels.setdefault(name, []).append(standing)
        figure, every = share_panels(self.title, list(panels), "share of scenes")
        for axes, standings in zip(every, panels.values(), strict=True):
            colours = coloured([_label(standing) for standing in standings])
            series = [Series(_label(one), one.stages, colours[_label(one)]) for one in standings]
            stages = [stage.stage for stage in standings[0].stages]
            bars(axes, stages, series)
            for paper in self.published:
                if paper.task == standings[0].task:
                    axes.scatter(len(stages) - 1, paper.mean, **MARK, label="VLATest, mean of seven")
        save(figure, path)


def _label(standing: Standing) -> str:
    return standing.policy if standing.confounders is None else plural(standing.confounders, "confounder")


def _row(standing: Standing) -> Row:
    return {
        "policy": standing.policy,
        **({} if standing.confounders is None else {"confounders": standing.confounders}),
        **{stage.stage: str(stage) for stage in standing.stages},
        "progress": None if standing.progress is None else f"{standing.progress:.2f}",
        "judged": standing.judged,
        "invalid": standing.invalid,
        "errors": standing.errors,
    }


def _paper_row(paper: Published) -> Row:
    least, most = (choose(paper.policies.items(), key=lambda item: item[1]) for choose in (min, max))
    elsewhere = f", elsewhere {percent(paper.as_well)}" if paper.as_well else ""
    return {
        "task": paper.task,
        "mean of seven": percent(paper.mean) + elsewhere,
        "least": f"{percent(least[1])} ({least[0]})",
        "most": f"{percent(most[1])} ({most[0]})",
    }


def _similar_row(row: Similarity) -> Row:
    values = {"progress": row.progress_similar, "of others": row.progress_other, "A12": row.a12}
    return {
        "task": row.task,
        "policy": row.policy,
        "similar scenes": row.similar,
        "others": row.other,
        **{name: None if value is None else round(value, 2) for name, value in values.items()},
        "p (Holm)": chance(row.p, row.adjusted),
    }
