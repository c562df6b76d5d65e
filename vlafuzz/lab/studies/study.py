"""The studies: the runs that each needs, and what they come to."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

from vlafuzz.campaign.config import RunConfig
from vlafuzz.campaign.forecast import usual_speed
from vlafuzz.campaign.launch import SpeedOf
from vlafuzz.common.files import make_folder, write_whole
from vlafuzz.common.watch import SILENT, Watch
from vlafuzz.errors import UsageError
from vlafuzz.lab.studies import mutants, published, wordings
from vlafuzz.lab.studies.runner import COUNTS, JUDGED, Part, StudyRunner, Tried, Variant, distinct, operators_of, pooled
from vlafuzz.lab.studies.sheet import StudyResult, adjusted
from vlafuzz.lab.studies.stages import Similarity, StageResult, Standing, in_paper, similarities, standing
from vlafuzz.lab.studies.unseen import UnseenResult, difference, paired_tests
from vlafuzz.model.outcome import Verdict
from vlafuzz.rollouts.policies import check_policy_name
from vlafuzz.search.base import POOL, RANDOM
from vlafuzz.store.records import Run, Trial
from vlafuzz.store.store import Store
from vlafuzz.worlds.manipulation.operators import Wording
from vlafuzz.worlds.manipulation.rigs import PANDA, rig
from vlafuzz.worlds.provenance import commit
from vlafuzz.worlds.tabletop.objects import Pack
from vlafuzz.worlds.tabletop.objects.catalogue import stored_catalogue
from vlafuzz.worlds.tabletop.space import OperatorSet, SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS

SAMPLES = (RANDOM, POOL)  # strategies whose scenes do not depend on earlier outcomes


@dataclass(frozen=True)
class StudyRequest:
    """What a user asks of a study: no tasks are all of its tasks, policy None is the default policy.

    RQ3 draws the light as ``alpha`` says; the packs ``unseen`` hold RQ5's unseen objects.
    """

    study: str
    tasks: Sequence[str] = ()
    policies: Sequence[str | None] = (None,)
    alpha: mutants.Alpha = "linear"
    unseen: Sequence[Pack] = ()

    def parts(self) -> list[Part]:
        """The runs of random scenes."""
        tasks = self.tasks or (wordings.two_steps() if self.study == "prompts" else TASKS)
        counts = COUNTS if self.study == "rq2" else (None,)
        return [Part(task, count, policy) for policy in self.policies for task in tasks for count in counts]


def ranges_for(robot: str | None) -> str:
    """The file of ranges that studies use for a robot: the paper's, or that of another robot."""
    return "paper-rq1" if robot in (None, PANDA.robot) else rig(robot).operators


def study(
    request: StudyRequest, config: RunConfig, folder: Path, watch: Watch = SILENT, speed_of: SpeedOf = usual_speed
) -> StudyResult:
    """Do the runs that the folder's store lacks, each of ``config.budget`` scenes, and count all.

    ``speed_of``: see ``do_missing``.
    """
    operators = load_operators(config.operators)
    for policy in filter(None, request.policies):
        check_policy_name(policy)
    make_folder(folder)
    with Store.open(folder / "study.db", "write") as store:
        runner = StudyRunner(
            config=config,
            operators=operators,
            store=store,
            folder=folder,
            commit=commit(),
            watch=watch,
            speed_of=speed_of,
        )
        return STUDIES[request.study](runner, request)


def study_of(stores: Sequence[Path]) -> StageResult:
    """RQ1 of stored runs of random scenes or of a file of scenes; other runs are no sample."""
    counted = []
    for path in stores:
        with Store.open(path) as store:
            samples = [run for run in store.runs() if run.manifest.strategy in SAMPLES]
            counted += [standing(store, run) for run in samples if store.count(run.id)]
    if not counted:
        raise UsageError(
            f"{', '.join(map(str, stores))}: no run with scenes of strategy {' or '.join(SAMPLES)}",
            hint="scenes of a guided strategy are no sample of the space",
        )
    return _stage_result("rq1", counted, [], [])


def write(result: StudyResult, folder: Path) -> dict[str, Any]:
    """Write JSON, markdown and plot, named after the study; returns the JSON."""
    make_folder(folder)
    document = asdict(result, dict_factory=_with_shares)
    text = json.dumps(document, indent=1, allow_nan=False)
    try:
        write_whole(folder / f"{result.study}.json", text + "\n")
        write_whole(folder / f"{result.study}.md", result.markdown())
        result.draw(folder / f"{result.study}.png")
    except OSError as error:
        raise UsageError(f"--out: {error}", hint="all runs are stored: the same command continues") from None
    return document


def _with_shares(fields: list[tuple[str, Any]]) -> dict[str, Any]:
    """A dataclass as JSON; a ``Share`` with the value of its share."""
    values = dict(fields)
    if {"count", "of", "low", "high"} <= values.keys():
        values["share"] = values["count"] / values["of"] if values["of"] else 0.0
    return values


def _stage_study(runner: StudyRunner, request: StudyRequest) -> StageResult:
    """RQ1 and RQ2."""
    runs = runner.run_random(request.parts())
    counted = [standing(runner.store, run, part.confounders) for part, run in runs.items()]
    similar = []
    if request.study == "rq2":
        catalogue = stored_catalogue(*(run.manifest for run in runs.values()))
        similar = similarities(runner.store, list(runs.values()), catalogue)
    return _stage_result(request.study, counted, similar, runner.left_out)


def _stage_result(name: str, counted: list[Standing], similar: list[Similarity], left_out: list[str]) -> StageResult:
    tasks = dict.fromkeys(standing.task for standing in counted) if name == "rq1" else ()
    policies = list(dict.fromkeys(standing.policy for standing in counted))
    return StageResult(name, policies, left_out, counted, [in_paper(task) for task in tasks], similar)


def _mutation_study(runner: StudyRunner, request: StudyRequest) -> mutants.MutationResult:
    """RQ3 and RQ4."""

    def make(part: Part, run: Run, trials: list[Trial]) -> tuple[OperatorSet, list[Variant]]:
        operators = mutants.mutating(request.study, operators_of(part, runner.operators), request.alpha)
        space = SearchSpace(operators, stored_catalogue(run.manifest), part.task, run.manifest.robot)
        passed = [trial.scene for trial in trials if trial.outcome.verdict is Verdict.PASSED]
        return operators, mutants.mutants(space, passed, runner.config.seed)

    by_policy: dict[str, dict[str, list[Tried]]] = {}
    for run, _, variants in _varied(runner, request, make):
        by_policy.setdefault(run.manifest.policy, {})[run.manifest.task] = variants
    rows, curves = [], []
    for policy, by_task in by_policy.items():
        together = pooled(by_task.values())
        tasks = {**by_task, **({mutants.ALL: together} if len(by_task) > 1 else {})}
        rows += [mutants.kept(task, policy, variants) for task, variants in tasks.items()]
        curves += mutants.curve_points(request.study, policy, together)
    return mutants.MutationResult(
        request.study,
        list(by_policy),
        runner.left_out,
        request.alpha if request.study == "rq3" else None,
        rows,
        curves,
        [row for row in published.rows(published.Mutated) if row.study == request.study],
    )


def _unseen_study(runner: StudyRunner, request: StudyRequest) -> UnseenResult:
    """RQ5."""
    parts = {part: part._replace(arm="unseen") for part in request.parts()}
    seen = runner.run_random(parts)
    unseen = runner.run_random(parts.values(), request.unseen)
    differences = [
        difference(standing(runner.store, seen[part]), standing(runner.store, unseen[other]))
        for part, other in parts.items()
        if part in seen and other in unseen
    ]
    if not differences:
        raise UsageError("rq5: no task has room for both seen and unseen objects", hint="widen the --operators")
    policies = list(dict.fromkeys(row.policy for row in differences))
    packs = [pack.name for pack in request.unseen]
    return UnseenResult(request.study, policies, runner.left_out, packs, differences, paired_tests(differences))


def _wording_study(runner: StudyRunner, request: StudyRequest) -> wordings.WordingResult:
    """RQ6 and the prompts of the discussion."""
    study = cast(wordings.Study, request.study)
    prompts = {part.task: wordings.prompts(study, part.task) for part in request.parts()}

    def make(part: Part, run: Run, trials: list[Trial]) -> tuple[OperatorSet, list[Variant]]:
        scenes, catalogue = [trial.scene for trial in trials], stored_catalogue(run.manifest)
        operators = operators_of(part, runner.operators).only([Wording.name])
        return operators, wordings.variants(scenes, prompts[part.task], catalogue)

    together, rows = [], []
    for run, trials, reworded in _varied(runner, request, make):
        task, policy, plain = run.manifest.task, run.manifest.policy, [trial.outcome for trial in trials]
        together.append(wordings.together(task, policy, plain, reworded))
        rows += wordings.compared(task, policy, plain, reworded, prompts[task])
    policies = list(dict.fromkeys(row.policy for row in together))
    return wordings.WordingResult(request.study, policies, runner.left_out, together, adjusted(rows))


def _varied(
    runner: StudyRunner,
    request: StudyRequest,
    make: Callable[[Part, Run, list[Trial]], tuple[OperatorSet, list[Variant]]],
) -> list[tuple[Run, list[Trial], list[Tried]]]:
    """Each run of random scenes with its judged trials, and the outcomes of the variants made of these."""
    bases = [
        (part, run, [trial for trial in distinct(runner.store, run) if trial.outcome.verdict in JUDGED])
        for part, run in runner.run_random(request.parts()).items()
    ]
    variants = {part._replace(arm=request.study): make(part, run, trials) for part, run, trials in bases}
    done = runner.run_variants(variants)
    return [(run, trials, done[part._replace(arm=request.study)]) for part, run, trials in bases]


STUDIES: dict[str, Callable[[StudyRunner, StudyRequest], StudyResult]] = {
    "rq1": _stage_study,
    "rq2": _stage_study,
    "rq3": _mutation_study,
    "rq4": _mutation_study,
    "rq5": _unseen_study,
    "rq6": _wording_study,
    "prompts": _wording_study,
}
