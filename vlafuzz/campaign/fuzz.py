"""fuzz: the one place where strategy, space, executor and store meet. It imports no simulator."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from vlafuzz.campaign.causes import attribution
from vlafuzz.campaign.results import Embed, clusters
from vlafuzz.campaign.tally import Summary, Tally
from vlafuzz.deadline import TimeOverError
from vlafuzz.errors import PolicyError, StoreError, UsageError
from vlafuzz.execute.base import Executor
from vlafuzz.outcome import Outcome, Verdict
from vlafuzz.rigs.robots import rig
from vlafuzz.scene import Scene
from vlafuzz.scoring import Measure, Objective, cell, score
from vlafuzz.search.base import Genome, Proposal, Strategy, causes_found, looks_for_causes
from vlafuzz.store.records import Manifest, Spent, Status, Trial
from vlafuzz.store.store import Store

PATIENCE = 50  # proposals in a row without a rollout
GONE = 8  # scenes in a row to which the policy did not answer, after which no more is expected of it
_TIME_OVER = "its time is over; with --resume it goes on"
AFRESH = "leave out --resume to start a new run: stored outcomes are reused at no cost"


class Space(Measure, Protocol):
    """The part of a search space that a campaign needs."""

    def decode(self, genome: Genome) -> Scene: ...


def fuzz(
    *,
    manifest: Manifest,
    stages: Sequence[str],
    space: Space,
    strategy: Strategy,
    executor: Executor,
    store: Store,
    objective: Objective = score,
    embed: Embed | None = None,
    chunk: int = 1,
    patience: int | None = PATIENCE,
    resume: int | None = None,
    alone: bool = False,
    watch: Callable[[Tally], None] = lambda tally: None,
) -> Summary:
    """Run a strategy against a policy until the budget is spent or there is nothing more to roll out.

    Proposals are asked for in batches of ``manifest.batch`` and told in the order asked, so one seed gives
    the same scenes whatever the executor. Stored outcomes are reused at no cost. The ``budget`` counts policy
    rollouts and is never exceeded. An interruption loses no trial, except that scenes of the last batch to
    which the policy did not answer are tried again on resuming.

    Args:
        embed: the embedding of scenes by which near-duplicates among the failures are grouped.
        chunk: scenes that the executor gets at once; more than one suits an executor that batches.
        patience: proposals in a row without a rollout after which the run stops; None for never.
        resume: a run that ended early; a new strategy is told the stored trials again, so that the result is
            that of an uninterrupted run.
        alone: reuse no outcomes of other runs, for comparisons in which every run pays for itself.
        watch: called after every new trial, and once after the stored trials.

    Raises:
        StoreError: the store cannot be written, or the strategy is not that of the run that is resumed.
        PolicyError: the policy no longer answers; the run can be resumed.
    """
    run, before = (store.begin(manifest), Spent(0.0)) if resume is None else (resume, store.reopen(resume))
    tally = Tally(run, manifest, stages, before)
    past, own = Past(store, run), run if alone else None
    campaign = _Campaign(
        tally=tally,
        past=past,
        space=space,
        strategy=strategy,
        executor=executor,
        store=store,
        objective=objective,
        chunk=chunk,
        own=own,
        watch=watch,
    )
    status: Status = "failed"
    try:
        campaign.loop(patience)
        status = "stopped" if tally.stopped else "finished"
    except TimeOverError:
        status, tally.stopped = "interrupted", _TIME_OVER
    except (KeyboardInterrupt, PolicyError):
        status = "interrupted"
        raise
    finally:
        store.finish(run, status, *tally.spent)
        if looks_for_causes(strategy) and not past.left:
            store.keep_causes(run, attribution(strategy, space, store, run))
    failures = [finding.scene for finding in store.findings(run)] if embed else []
    groups = clusters(failures, embed) if embed else None
    return tally.summary(str(store.path), groups)


@dataclass(kw_only=True)
class _Campaign:
    tally: Tally
    past: Past
    space: Space
    strategy: Strategy
    executor: Executor
    store: Store
    objective: Objective
    chunk: int
    own: int | None  # the only run whose outcomes are reused
    watch: Callable[[Tally], None]
    unanswered: list[Trial] = field(default_factory=list)  # of the batch, since the last answer; not stored
    in_a_row: int = 0  # of those, in this batch and before

    def loop(self, patience: int | None) -> None:
        while not self.tally.stopped and (room := self._room()) > 0:
            proposals = self._ask(room)
            if not proposals:
                break
            scenes = [self.space.decode(proposal.genome) for proposal in proposals]
            outcomes = self._evaluate(proposals, scenes)
            self.tally.judge(scenes, outcomes, patience)
            pairs = zip(scenes, outcomes, strict=True)
            scores = [self.objective(*pair, self.space) for pair in pairs]
            with self.tally.search:
                self.strategy.tell(proposals, scores)
                if looks_for_causes(self.strategy):
                    self.tally.causes = causes_found(self.strategy)
        self.past.check_empty()

    def _ask(self, room: int) -> list[Proposal]:
        with self.tally.search:
            proposals = self.strategy.ask(room)
        if len(proposals) > room:  # a user's own strategy may, but the budget holds
            name = self.tally.manifest.strategy
            problem = f"strategy {name!r}: asked for {room} proposals, got {len(proposals)}"
            raise UsageError(problem, hint="give at most as many")
        return proposals

    def _room(self) -> int:
        left = self.tally.manifest.budget - self.tally.rollouts
        return min(self.tally.manifest.batch, left // self.tally.manifest.repeats)

    def _evaluate(self, proposals: Sequence[Proposal], scenes: Sequence[Scene]) -> list[Outcome]:
        """The outcome of each proposal; all are stored, new outcomes before reused ones."""
        past = self._recall(proposals, scenes)
        outcomes = {trial.scene.digest: trial.outcome for trial in past.values()}
        fresh: dict[str, int] = {}
        for index, scene in enumerate(scenes):
            if scene.digest in outcomes or scene.digest in fresh:
                continue
            with self.tally.store:
                known = self.store.known(scene, self.tally.manifest.key(), self.own)
            if known is None:
                fresh[scene.digest] = index
            else:
                outcomes[scene.digest] = known
        for index, outcome in self._run(scenes, list(fresh.values())):
            outcomes[scenes[index].digest] = outcome
            self._take(self._trial(proposals[index], scenes[index], outcome, duplicate=False))
        self._keep_unanswered()
        for index, scene in enumerate(scenes):
            if index not in past and fresh.get(scene.digest) != index:
                self._keep(self._trial(proposals[index], scene, outcomes[scene.digest], duplicate=True))
        return [outcomes[scene.digest] for scene in scenes]

    def _recall(self, proposals: Sequence[Proposal], scenes: Sequence[Scene]) -> dict[int, Trial]:
        """The stored trials of the batch, which are counted."""
        with self.tally.store:
            past = self.past.take(proposals, scenes)
        for trial in past.values():
            self.tally.count(trial)
        if past and not self.past.left:
            self.watch(self.tally)
        return past

    def _run(self, scenes: Sequence[Scene], wanted: list[int]) -> Iterator[tuple[int, Outcome]]:
        chunks = [wanted[first : first + self.chunk] for first in range(0, len(wanted), self.chunk)]
        batches = ((tag, [scenes[index] for index in chunk]) for tag, chunk in enumerate(chunks))
        for tag, outcomes in self.executor.run(batches):
            yield from zip(chunks[tag], outcomes, strict=True)

    def _take(self, trial: Trial) -> None:
        """Store a trial; one to which the policy did not answer is stored once it answers again.

        Raises:
            PolicyError: the policy no longer answers.
        """
        if not trial.outcome.unanswered:
            if trial.outcome.verdict is not Verdict.INVALID:  # for which the policy was not asked
                self.in_a_row = 0
                self._keep_unanswered()
            self._keep(trial)
            return
        self.unanswered.append(trial)
        self.in_a_row += 1
        if self.in_a_row == GONE:
            problem = f"{GONE} scenes in a row had no answer: {trial.outcome.detail}"
            raise PolicyError(problem, hint="repeat the command once the policy answers", cause="connect")

    def _keep_unanswered(self) -> None:
        for trial in self.unanswered:
            self._keep(trial)
        self.unanswered.clear()

    def _keep(self, trial: Trial) -> None:
        with self.tally.store:
            self.store.add(self.tally.run, trial)
        self.tally.count(trial)
        self.watch(self.tally)

    def _trial(self, proposal: Proposal, scene: Scene, outcome: Outcome, *, duplicate: bool) -> Trial:
        place = None
        if outcome.verdict is Verdict.FAILED:
            place = cell(scene, outcome, self.space.severities(scene), rig(scene.robot).workspace)
        return Trial(
            proposal=proposal.id,
            scene=scene,
            outcome=outcome,
            severity=self.space.severity(scene),
            genome=proposal.genome,
            cell=place,
            duplicate=duplicate,
        )


class Past:
    """Hands out a run's stored trials batch by batch, as its strategy proposes them again.

    Attributes:
        left: trials not yet handed out; 0 for a new run.
    """

    def __init__(self, store: Store, run: int) -> None:
        self._store, self._run = store, run
        self.left = store.count(run)

    def take(self, proposals: Sequence[Proposal], scenes: Sequence[Scene]) -> dict[int, Trial]:
        """The stored trials of a batch by index; an interrupted batch lacks some."""
        if not self.left:
            return {}
        first = proposals[0].id
        stored = self._store.stored(self._run, first, len(scenes))
        trials = {trial.proposal - first: trial for trial in stored}
        for index, trial in trials.items():
            same = trial.genome is not None and np.array_equal(trial.genome, proposals[index].genome)
            if not same or trial.scene != scenes[index]:
                raise self._diverged(trial.proposal)
        self.left -= len(trials)
        if len(trials) < len(scenes):
            self.check_empty()
        return trials

    def check_empty(self) -> None:
        """Raise a StoreError if a stored trial was not handed out."""
        if self.left:
            raise self._diverged(self._store.count(self._run) - self.left)

    def _diverged(self, proposal: int) -> StoreError:
        problem = f"was made by another version: its strategy now differs at proposal {proposal}"
        hint = f"use the version that began it, or {AFRESH}"
        return StoreError(f"{self._store.path}: run {self._run} {problem}", hint)
