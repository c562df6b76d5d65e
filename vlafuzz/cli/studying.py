"""What ``vlafuzz study`` does: the runs that are missing, with a bar, and what all of them come to."""

from __future__ import annotations

import json as json_format
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vlafuzz.errors import UsageError, VlafuzzError

if TYPE_CHECKING:
    from vlafuzz.cli.pace import Pace
    from vlafuzz.config import Plan, RunConfig
    from vlafuzz.corpus.records import Run
    from vlafuzz.corpus.store import Corpus
    from vlafuzz.space import OperatorSet
    from vlafuzz.studies.parts import Part
    from vlafuzz.studies.similar import Similarity
    from vlafuzz.studies.stages import Published, Standing

STORE = "study.db"
SAMPLES = ("random", "pool")  # strategies that choose no scenes by what came of others


@dataclass(frozen=True)
class Study:
    """What a study came to; only RQ1 has figures of the paper beside it."""

    study: str
    subjects: list[str]
    standings: list[Standing]
    published: list[Published]
    similar: list[Similarity]

    @property
    def title(self) -> str:
        return f"{self.study.upper()}: {', '.join(self.subjects)}"


def study(
    name: str, asked: RunConfig, tasks: Sequence[str], subjects: Sequence[str | None], folder: Path
) -> Study:
    """Run what is missing in the folder's store, and count what is there.

    Args:
        asked: the same for all runs; its ``budget`` is the number of scenes of each.
        subjects: None for the default one.
    """
    from vlafuzz.corpus.store import Corpus
    from vlafuzz.space import load_operators
    from vlafuzz.studies.parts import parts_of
    from vlafuzz.studies.stages import standing

    operators = load_operators(asked.operators)
    plans = {part: _plan(part, asked, operators, folder) for part in parts_of(name, tasks, subjects)}
    _make(folder)
    with Corpus.open(folder / STORE, "write") as corpus:
        runs = _run(plans, corpus)
        counted = [standing(corpus, run, part.confounders) for part, run in runs.items()]
        return _told(name, counted, _similar(corpus, list(runs.values())) if name == "rq2" else [])


def study_of(stores: Sequence[Path]) -> Study:
    """RQ1 of the runs that stores have: of random scenes, or those of a file. Others are no sample."""
    from vlafuzz.corpus.store import Corpus
    from vlafuzz.studies.stages import standing

    counted = []
    for path in stores:
        with Corpus.open(path) as corpus:
            fair = [run for run in corpus.runs() if run.manifest.strategy in SAMPLES]
            counted += [standing(corpus, run) for run in fair if corpus.count(run.id)]
    if not counted:
        raise UsageError(
            f"{', '.join(map(str, stores))}: no run with scenes of strategy {' or '.join(SAMPLES)}",
            hint="what a guided strategy proposes is no sample of the scenes",
        )
    return _told("rq1", counted, [])


def _told(name: str, counted: list[Standing], similar: list[Similarity]) -> Study:
    from vlafuzz.studies.stages import in_paper

    tasks = dict.fromkeys(each.task for each in counted) if name == "rq1" else ()
    subjects = list(dict.fromkeys(each.subject for each in counted))
    return Study(name, subjects, counted, [in_paper(task) for task in tasks], similar)


def _similar(corpus: Corpus, runs: Sequence[Run]) -> list[Similarity]:
    from vlafuzz.corpus.packs import stored_catalogue
    from vlafuzz.studies.similar import adjusted, similarity

    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.manifest.subject, run.manifest.task), []).append(run)
    catalogue = stored_catalogue(*(run.manifest for run in runs))
    return adjusted([similarity(corpus, its, catalogue) for its in groups.values()])


def write(made: Study, folder: Path) -> dict[str, Any]:
    """study.json, study.md and stages.png; the JSON."""
    from vlafuzz.studies.sheet import markdown, plot

    _make(folder)
    told = asdict(made)
    (folder / "study.json").write_text(json_format.dumps(told, indent=1, allow_nan=False) + "\n")
    sheet = markdown(made.title, made.standings, made.published, made.similar)
    (folder / "study.md").write_text(sheet, "utf-8")
    plot(made.title, made.standings, made.published, folder / "stages.png")
    return told


def _plan(part: Part, asked: RunConfig, operators: OperatorSet, folder: Path) -> Plan:
    from vlafuzz import config
    from vlafuzz.studies.parts import operators_of

    own = replace(asked, task=part.task, subject=part.subject, strategy="random", store=folder / STORE)
    return config.plan(own, operators_of(part, operators))


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise UsageError(f"--out: {folder}: cannot be made: {reason}", hint="give another folder") from None


def _run(plans: dict[Part, Plan], corpus: Corpus) -> dict[Part, Run]:
    """Do the runs that are missing: those of all parts that have a scene."""
    from vlafuzz.cli.pace import Pace
    from vlafuzz.corpus.records import UNFINISHED
    from vlafuzz.studies.parts import stored

    there = {part: stored(corpus.path, corpus.runs(), plan.manifest) for part, plan in plans.items()}
    problem: UsageError | None = None
    early = {part: run for part, run in there.items() if run is None or run.status in UNFINISHED}
    if early:
        over = [run for run in there.values() if run]
        with Pace(len(early), next(iter(plans.values())).manifest.budget, over) as pace:
            for part, run in early.items():
                pace.begin(str(part))
                try:
                    _fuzz(plans[part], run, corpus, pace)
                except UsageError as error:  # boxes of the paper have no room for all of its confounders
                    pace.say(f"{part}: left out: {error.message}")
                    problem = error
    runs = {part: stored(corpus.path, corpus.runs(), plan.manifest) for part, plan in plans.items()}
    done = {part: run for part, run in runs.items() if run and corpus.count(run.id)}
    if not done and problem:
        raise problem
    return done


def _fuzz(plan: Plan, early: Run | None, corpus: Corpus, pace: Pace) -> None:
    """Begin a run, or go on with it."""
    from vlafuzz import launch

    planned = replace(plan, manifest=early.manifest, resume=early.id) if early else plan
    with closing(launch.make_executor(planned)) as executor:
        summary = launch.fuzz(planned, corpus, executor, pace, alone=True)
    if summary.stopped:
        pace.say(f"{summary.task} stopped: {summary.stopped}")
    if summary.verdicts["error"] and not summary.verdicts["passed"] + summary.verdicts["failed"]:
        raise VlafuzzError(
            f"no scene could be judged: {summary.last_error}",
            hint="`vlafuzz doctor` checks this machine; then begin with another --out",
        )
