"""What ``vlafuzz study`` does: the runs of each study, and what they come to."""

from __future__ import annotations

import json as json_format
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

from vlafuzz.campaign.config import RunConfig
from vlafuzz.cli.laboratory import StudyRunner
from vlafuzz.conditions.packs import stored_catalogue
from vlafuzz.conditions.provenance import commit
from vlafuzz.errors import UsageError
from vlafuzz.objects import Pack
from vlafuzz.outcome import Verdict
from vlafuzz.policies.registry import check_policy_name
from vlafuzz.space import OperatorSet, SearchSpace, load_operators
from vlafuzz.space.operators import Wording
from vlafuzz.store.records import Run, Trial
from vlafuzz.store.store import Store
from vlafuzz.studies import published, wordings
from vlafuzz.studies.mutants import ALL, MUTATED, Alpha, kept, mutants, mutating, points
from vlafuzz.studies.mutants_sheet import Mutated
from vlafuzz.studies.parts import Part, operators_of, parts_of
from vlafuzz.studies.sheet import Found, Sheet
from vlafuzz.studies.similar import Similarity, adjusted, similarity
from vlafuzz.studies.stages import Standing, in_paper, standing
from vlafuzz.studies.stages_sheet import Staged
from vlafuzz.studies.unseen import difference, paired_tests
from vlafuzz.studies.unseen_sheet import Unseen
from vlafuzz.studies.variants import JUDGED, Tried, Variant, distinct, pooled, tried
from vlafuzz.studies.wordings_sheet import Said
from vlafuzz.tasks.tabletop import TASKS

STORE = "study.db"
SAMPLES = ("random", "pool")  # strategies that choose no scenes by what came of others


@dataclass(frozen=True)
class Wish:
    """What a user asks of a study.

    Attributes:
        tasks: none for all that it has.
        policies: None for the default one.
        alpha: how RQ3 draws the light.
        unseen: the packs of RQ5's unseen objects.
    """

    study: str
    tasks: Sequence[str] = ()
    policies: Sequence[str | None] = (None,)
    alpha: Alpha = "linear"
    unseen: Sequence[Pack] = ()

    def parts(self) -> list[Part]:
        """The first runs."""
        own = wordings.two_steps() if self.study == "prompts" else TASKS
        return parts_of(self.study, list(self.tasks or own), self.policies)


def study(wish: Wish, asked: RunConfig, folder: Path) -> Found:
    """Run what is missing in the folder's store, and count what is there.

    Args:
        asked: the same for all runs; its ``budget`` is the number of scenes of each.
    """
    operators = load_operators(asked.operators)
    for policy in filter(None, wish.policies):
        check_policy_name(policy)
    _make(folder)
    with Store.open(folder / STORE, "write") as store:
        return STUDIES[wish.study](StudyRunner(asked, operators, store, folder, commit()), wish)


def study_of(stores: Sequence[Path]) -> Staged:
    """RQ1 of the runs that stores have: of random scenes, or those of a file. Others are no sample."""
    counted = []
    for path in stores:
        with Store.open(path) as store:
            fair = [run for run in store.runs() if run.manifest.strategy in SAMPLES]
            counted += [standing(store, run) for run in fair if store.count(run.id)]
    if not counted:
        raise UsageError(
            f"{', '.join(map(str, stores))}: no run with scenes of strategy {' or '.join(SAMPLES)}",
            hint="what a guided strategy proposes is no sample of the scenes",
        )
    return _staged("rq1", counted, [], [])


def write(found: Found, folder: Path) -> tuple[dict[str, Any], Sheet]:
    """JSON, markdown and plot, named after the study; what they say."""
    _make(folder)
    told, sheet = asdict(found), found.sheet()
    try:
        (folder / f"{found.study}.json").write_text(json_format.dumps(told, indent=1, allow_nan=False) + "\n")
        (folder / f"{found.study}.md").write_text(sheet.markdown(), "utf-8")
        sheet.draw(folder / f"{found.study}.png")
    except OSError as error:
        raise UsageError(f"--out: {error}", hint="what was run is stored: the same command goes on") from None
    return told, sheet


def _stages(runner: StudyRunner, wish: Wish) -> Staged:
    """RQ1, RQ2."""
    runs = runner.sampled(wish.parts())
    counted = [standing(runner.store, run, part.confounders) for part, run in runs.items()]
    similar = _similar(runner.store, list(runs.values())) if wish.study == "rq2" else []
    return _staged(wish.study, counted, similar, runner.left_out)


def _staged(name: str, counted: list[Standing], similar: list[Similarity], left_out: list[str]) -> Staged:
    tasks = dict.fromkeys(each.task for each in counted) if name == "rq1" else ()
    policies = list(dict.fromkeys(each.policy for each in counted))
    return Staged(name, policies, left_out, counted, [in_paper(task) for task in tasks], similar)


def _similar(store: Store, runs: Sequence[Run]) -> list[Similarity]:
    groups: dict[tuple[str, str], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.manifest.policy, run.manifest.task), []).append(run)
    catalogue = stored_catalogue(*(run.manifest for run in runs))
    return adjusted([similarity(store, its, catalogue) for its in groups.values()])


def _mutated(runner: StudyRunner, wish: Wish) -> Mutated:
    """RQ3, RQ4."""

    def make(part: Part, run: Run, trials: list[Trial]) -> tuple[OperatorSet, list[Variant]]:
        operators = mutating(wish.study, operators_of(part, runner.operators), wish.alpha)
        space = SearchSpace(operators, stored_catalogue(run.manifest), part.task, run.manifest.robot)
        passed = [trial.scene for trial in trials if trial.outcome.verdict is Verdict.PASSED]
        return operators, mutants(space, passed, runner.asked.seed)

    by_policy: dict[str, dict[str, list[Tried]]] = {}
    for run, _, found in _varied(runner, wish, make):
        by_policy.setdefault(run.manifest.policy, {})[run.manifest.task] = found
    rows, curves = [], []
    for policy, by_task in by_policy.items():
        every = {**by_task, **({ALL: pooled(by_task.values())} if len(by_task) > 1 else {})}
        rows += [kept(task, policy, found) for task, found in every.items()]
        curves += points(wish.study, policy, pooled(by_task.values()))
    return Mutated(
        wish.study,
        list(by_policy),
        runner.left_out,
        wish.alpha if wish.study == "rq3" else None,
        rows,
        curves,
        [row for row in published.mutated() if row.study == wish.study],
    )


def _unseen(runner: StudyRunner, wish: Wish) -> Unseen:
    """RQ5."""
    parts = {part: part._replace(arm="unseen") for part in wish.parts()}
    seen = runner.sampled(parts)
    unseen = runner.sampled(parts.values(), wish.unseen)
    found = [
        difference(standing(runner.store, seen[part]), standing(runner.store, unseen[other]))
        for part, other in parts.items()
        if part in seen and other in unseen
    ]
    if not found:
        raise UsageError(
            "rq5: no task has room for both seen and unseen objects", hint="widen the --operators"
        )
    policies = list(dict.fromkeys(each.policy for each in found))
    packs = [pack.name for pack in wish.unseen]
    return Unseen(wish.study, policies, runner.left_out, packs, found, paired_tests(found))


def _said(runner: StudyRunner, wish: Wish) -> Said:
    """RQ6, prompts."""
    study = cast(wordings.Study, wish.study)
    ways = {part.task: wordings.prompts(study, part.task) for part in wish.parts()}

    def make(part: Part, run: Run, trials: list[Trial]) -> tuple[OperatorSet, list[Variant]]:
        scenes, catalogue = [trial.scene for trial in trials], stored_catalogue(run.manifest)
        operators = operators_of(part, runner.operators).only([Wording.name])
        return operators, wordings.variants(scenes, ways[part.task], catalogue)

    whole, found = [], []
    for run, trials, reworded in _varied(runner, wish, make):
        task, policy, plain = run.manifest.task, run.manifest.policy, [trial.outcome for trial in trials]
        whole.append(wordings.together(task, policy, plain, reworded))
        found += wordings.compared(task, policy, plain, reworded, ways[task])
    policies = list(dict.fromkeys(each.policy for each in whole))
    return Said(wish.study, policies, runner.left_out, whole, wordings.adjusted(found))


def _varied(
    runner: StudyRunner,
    wish: Wish,
    make: Callable[[Part, Run, list[Trial]], tuple[OperatorSet, list[Variant]]],
) -> list[tuple[Run, list[Trial], list[Tried]]]:
    """Each first run with its judged trials, and what came of the variants that ``make`` makes of these."""
    runs = runner.sampled(wish.parts())
    trials = {
        part: [trial for trial in distinct(runner.store, run) if trial.outcome.verdict in JUDGED]
        for part, run in runs.items()
    }
    arms = {part: part._replace(arm=wish.study) for part in runs}
    made = {arms[part]: make(part, run, trials[part]) for part, run in runs.items()}
    done = runner.given(made)
    return [
        (run, trials[part], tried(runner.store, done.get(arms[part]), made[arms[part]][1]))
        for part, run in runs.items()
    ]


STUDIES: dict[str, Callable[[StudyRunner, Wish], Found]] = {
    "rq1": _stages,
    "rq2": _stages,
    **dict.fromkeys(MUTATED, _mutated),
    "rq5": _unseen,
    "rq6": _said,
    "prompts": _said,
}


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = (error.strerror or "unknown reason").lower()
        raise UsageError(f"--out: {folder}: cannot be made: {reason}", hint="give another folder") from None
