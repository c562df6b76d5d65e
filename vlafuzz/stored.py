"""A store as rows for Python: runs, trials, findings and causes, each also as a pandas data frame."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from vlafuzz.errors import PrerequisiteError, SceneError, install
from vlafuzz.failures.causes import ListedCause, causes_of
from vlafuzz.failures.described import DescribedFailure, space_of
from vlafuzz.failures.listed import failures_of
from vlafuzz.model import Rate, Scene, Solver, Space, Verdict
from vlafuzz.model.space import value_at
from vlafuzz.report.tables import Standing, draws, standings_of
from vlafuzz.store.records import Run
from vlafuzz.store.store import Store

if TYPE_CHECKING:
    from pandas import DataFrame

T = TypeVar("T", covariant=True)


class Rows(tuple[T, ...]):
    """A tuple of values that can become a data frame."""

    def to_dataframe(self) -> DataFrame:
        """One row a value; ``rate.low`` is the column ``rate_low``, and several names are joined by "; ".

        Raises:
            PrerequisiteError: pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            message = "to_dataframe needs pandas, which is not installed"
            raise PrerequisiteError(message, hint=install("pandas")) from None
        return pandas.DataFrame([dict(_flat(value)) for value in self])


@dataclass(frozen=True, kw_only=True)
class StoredRun:
    """A run.

    Attributes:
        label: the name that the user gave the policy with ``--label``; empty without one.
        budget: in rollouts of the policy.
        status: ``running``, ``finished``, ``stopped``, ``interrupted`` or ``failed``.
        seconds: wall time; None while it runs.
        failed: scenes that failed, of those that were ``judged``; of a guided strategy no failure rate.
    """

    run: int
    task: str
    policy: str
    label: str
    strategy: str
    seed: int
    budget: int
    status: str
    seconds: float | None
    failed: int
    judged: int


@dataclass(frozen=True, kw_only=True)
class StoredTrial:
    """A proposal of a run with its outcome.

    Attributes:
        scene: digest.
        random: whether the scene was drawn at random, without regard to outcomes: only such trials give a failure rate.
            Of a guided run, those that passed or failed.
        verdict: ``passed``, ``failed``, ``invalid`` or ``error``; ``detail`` says why for the last two.
        progress: how far the policy came, in [0, 1].
        lost_stage: the first stage that it did not reach.
        severity: distance of the scene from the nominal one; ``severities``: by operator, each in [0, 1]; empty for
            scenes from elsewhere.
        values: those of the operators' parameters in metres, degrees and so on, such as ``camera-position.distance``;
            objects are numbered from 0: ``target-position.0.x``.
        seconds: wall time of the rollouts.
        duplicate: answered with a known outcome.
    """

    run: int
    proposal: int
    task: str
    policy: str
    label: str
    scene: str
    random: bool
    verdict: str
    progress: float
    lost_stage: str | None
    severity: float
    seconds: float
    duplicate: bool
    detail: str
    severities: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[str, float | str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class StoredFinding:
    """A failing scene, with what triage says of it; also what ``vlafuzz report --json`` prints.

    Attributes:
        scene: digest of the minimal scene if there is one, else of the finding; ``found``: of the finding.
        run: the one that found it; None in a corpus.
        evidence: the bucket of triage, such as ``minimal``; ``observed`` before it.
        operators: in which the scene differs from a passing one, the confounders' as one.
        conditions: the range that fails, or the value in the scene, by operator, in words with units.
        necessary: operators without which the policy passes; ``sufficient``: those that are enough alone.
        rate: how often the policy fails around ``scene``; None if unknown.
        witness: who solves ``scene``.
        detail: the evidence, in a sentence.
        replay: the command that shows it.
        before_event: whether the policy failed before any event of the scene had begun.
    """

    scene: str
    found: str
    run: int | None
    task: str
    policy: str
    label: str
    instruction: str
    lost_stage: str
    evidence: str
    signature: str | None
    operators: tuple[str, ...]
    conditions: tuple[str, ...]
    necessary: tuple[str, ...]
    sufficient: tuple[str, ...]
    rate: Rate | None
    witness: Solver | None
    detail: str
    replay: str
    before_event: bool


class StoredResults:
    """What a store holds. Every call reads it afresh, also while a run writes to it.

    Args:
        path: of the store.

    Raises:
        StoreError: from every method: the store is missing or damaged, or has no such run.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        Store.open(self.path).close()

    def runs(self) -> Rows[StoredRun]:
        """All runs, the oldest first."""
        with Store.open(self.path) as store:
            rows = []
            for run in store.runs():
                (failed, judged), of = store.judged([run.id]), run.manifest
                asked = {name: getattr(of, name) for name in ("task", "policy", "strategy", "seed", "budget")}
                told: dict[str, Any] = {"label": of.named, "seconds": run.seconds, **asked}
                rows.append(StoredRun(run=run.id, status=run.status, failed=failed, judged=judged, **told))
            return Rows(rows)

    def trials(self, run: int | None = None) -> Rows[StoredTrial]:
        """The trials of a run, by default of all, in the order of their proposals."""
        with Store.open(self.path) as store:
            return Rows(row for one in self._runs(store, run) for row in _trials(store, one))

    def findings(self, run: int | None = None) -> Rows[StoredFinding]:
        """The failing scenes of a run, by default of all, in the order of proposals."""
        with Store.open(self.path) as store:
            return Rows(map(finding_of, failures_of(store, run)))

    def causes(self, run: int | None = None) -> Rows[ListedCause]:
        """The causes of a run, confirmed ones first; by default of the last run that looked for any."""
        with Store.open(self.path) as store:
            for one in reversed(self._runs(store, run)):
                if listed := causes_of(store, one):
                    return Rows(listed.causes)
        return Rows()

    def standings(self) -> Rows[Standing]:
        """One row for each policy and task: failure rate, causes, rollouts."""
        with Store.open(self.path) as store:
            return Rows(standings_of(store))

    def _runs(self, store: Store, run: int | None) -> list[Run]:
        if run is not None:
            store.causes(run)  # raises if there is none
        return [one for one in store.runs() if run in (None, one.id)]


def _trials(store: Store, run: Run) -> Iterator[StoredTrial]:
    drawn, space, manifest = draws(store, run), space_of(store.path, run.manifest), run.manifest
    for trial in store.trials(run.id):
        outcome, severities = trial.outcome, dict[str, float]()
        with suppress(SceneError):  # an imported scene
            severities = space.severities(trial.scene)
        yield StoredTrial(
            run=run.id,
            proposal=trial.proposal,
            task=manifest.task,
            policy=manifest.policy,
            label=manifest.named,
            scene=trial.scene.digest,
            random=drawn(trial),
            verdict=outcome.verdict.name.lower(),
            progress=outcome.progress,
            lost_stage=outcome.lost_stage if outcome.verdict is Verdict.FAILED else None,
            severity=trial.severity,
            seconds=sum(rollout.seconds for rollout in outcome.rollouts),
            duplicate=trial.duplicate,
            detail=outcome.detail,
            severities=severities,
            values=dict(_values(space, trial.scene, severities)),
        )


def _values(space: Space, scene: Scene, operators: Container[str]) -> Iterator[tuple[str, float | str]]:
    """What the scene has for each parameter of some operators; a slot that it does not use is left out."""
    for path, gene in space.by_path.items():
        with suppress(IndexError):
            if gene.operator in operators:
                yield ".".join([gene.operator, *path.split(".")[1:]]), value_at(scene, path)


def finding_of(failure: DescribedFailure) -> StoredFinding:
    """The row of one failure."""
    return StoredFinding(
        scene=failure.scene.digest,
        found=failure.found[0],
        run=failure.number,
        task=failure.scene.task,
        policy=failure.run.policy,
        label=failure.run.named,
        instruction=failure.scene.instruction,
        lost_stage=failure.lost_stage,
        evidence=failure.bucket,
        signature=failure.signature or None,
        operators=failure.operators,
        conditions=tuple(f"{part.operator}: {part.range}" for part in failure.deviations),
        necessary=failure.causes.necessary,
        sufficient=failure.causes.sufficient,
        rate=failure.rate,
        witness=failure.witness.solver if failure.witness else None,
        detail=failure.detail,
        replay=failure.replay,
        before_event=failure.before_event > 0,
    )


def _flat(value: Any, before: str = "") -> Iterator[tuple[str, Any]]:
    """The columns of a row, in the order of its fields."""
    for name, inner in _fields(value).items():
        if _fields(inner):
            yield from _flat(inner, f"{before}{name}_")
        else:
            yield before + name, "; ".join(inner) if isinstance(inner, tuple) else inner


def _fields(value: Any) -> Mapping[str, Any]:
    """Those of a value that is not a single cell."""
    if isinstance(value, Mapping):
        return value
    names = [one.name for one in fields(value)] if is_dataclass(value) else getattr(value, "_fields", ())
    return {name: getattr(value, name) for name in names}
