"""Campaign: the one place where strategy, space, executor and store meet. It imports no simulator."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count, islice

import numpy as np

from vlafuzz.campaign.causes import attribution
from vlafuzz.campaign.tally import TIME_OVER, Summary, Tally
from vlafuzz.common.deadline import Deadline, TimeOverError
from vlafuzz.errors import PolicyError, StoreError, UsageError
from vlafuzz.failures.events import came_about
from vlafuzz.model import Outcome, Scene, Space, Verdict
from vlafuzz.rollouts.executor import Executor
from vlafuzz.search.base import Genome, Proposal, Strategy, looks_for_causes, overlaps, said_by
from vlafuzz.search.scoring import Score, score
from vlafuzz.store.records import Manifest, Status, Trial
from vlafuzz.store.store import Store

PATIENCE = 50  # proposals in a row without a rollout
GONE = 8  # scenes in a row that end in an error, after which nothing else is expected
EVERY, SHARE = 30.0, 0.02  # seconds between causes that are kept while a run goes on; of its time, at most
AHEAD = 4  # batches of later proposals among which there may be scenes for a worker that would wait
AFRESH = "leave out --resume to start a new run: stored outcomes are reused at no cost"


class Past:
    """Hands out a run's stored trials, as its strategy proposes them again.

    Attributes:
        left: trials not yet handed out; 0 for a new run.
    """

    def __init__(self, store: Store, run: int) -> None:
        self._store, self._run = store, run
        self.left, self._last = store.extent(run)

    def take(self, proposals: Sequence[Proposal], scenes: Sequence[Scene]) -> dict[int, Trial]:
        """The stored trials of these proposals by index; those that were in progress are missing."""
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
        if proposals[-1].id >= self._last:
            self.check_empty()
        return trials

    def check_empty(self) -> None:
        """Raise a StoreError if a stored trial was not handed out."""
        if self.left:
            raise self._diverged(self._store.extent(self._run)[0] - self.left)

    def _diverged(self, proposal: int) -> StoreError:
        problem = f"was made by another version: its strategy now differs at proposal {proposal}"
        hint = f"use the version that began it, or {AFRESH}"
        return StoreError(f"{self._store.path}: run {self._run} {problem}", hint)


@dataclass(eq=False)
class _Asked:
    """A proposal that the strategy has not been told about yet.

    Attributes:
        same: an earlier one of the same scene, which shares its outcome.
        duplicate: its outcome is that of another trial.
        kept: its trial is stored.
        score: how it ended, once that is looked at.
    """

    proposal: Proposal
    scene: Scene
    outcome: Outcome | None = None
    same: _Asked | None = None
    duplicate: bool = False
    kept: bool = False
    score: Score | None = None

    @property
    def settled(self) -> bool:
        """Whether its outcome is known."""
        return self.kept or (self.duplicate if self.same is None else self.same.settled)

    @property
    def result(self) -> Outcome:
        """The outcome of a proposal that is settled."""
        outcome = self.outcome if self.same is None else self.same.outcome
        assert outcome is not None
        return outcome


@dataclass(kw_only=True)
class Campaign:
    """A strategy against a policy, until the budget of rollouts is spent, or nothing is left to roll out.

    At most ``manifest.batch`` proposals are awaited at a time, and are told in the order asked: one seed gives the same
    scenes whatever the executor. A worker that would wait rolls out a scene that the strategy expects to propose; its
    outcome is stored and told when it does. Stored outcomes are reused at no cost. An interruption loses no trial; the
    last errors are tried again on resuming.

    Args:
        scenes: of a file, which the strategy proposes by their indices; by default those of the space.
        patience: proposals in a row without a rollout after which the run stops; None for never.
        resume: a run that ended early; a new strategy is told its trials again.
        more: rollouts beyond the budget, for a strategy that can ``conclude``; of a run that is resumed, those stored.
        alone: reuse no outcomes of other runs, for comparisons in which every run pays for itself.
        deadline: after which no scene is begun; the run can be resumed.
        watch: called after every new trial, and once after the stored trials.

    Attributes:
        early: scenes rolled out early that are not proposed yet; at the end, those that never were.
    """

    manifest: Manifest
    space: Space
    strategy: Strategy
    executor: Executor
    store: Store
    scenes: Sequence[Scene] = ()
    patience: int | None = PATIENCE
    resume: int | None = None
    more: int = 0
    alone: bool = False
    deadline: Deadline = field(default_factory=Deadline)
    watch: Callable[[Tally], None] = lambda tally: None

    def run(self) -> Summary:
        """Begin the run in the store, or resume one there, and go on to its end.

        Raises:
            StoreError: the store cannot be written, or the strategy is not that of the run that is resumed.
            PolicyError: the policy no longer answers; the run can be resumed.
        """
        store, strategy = self.store, self.strategy
        run = store.begin(self.manifest) if self.resume is None else self.resume
        before = 0.0 if self.resume is None else store.reopen(run, finished=self.more > 0)
        self.tally, self.past = Tally(run, self.manifest, before), Past(store, run)
        self._due = time.monotonic() + EVERY
        self._awaited, self._todo = deque[_Asked](), deque[_Asked]()  # in the order asked; of these, to be begun
        self._running, self._tags = dict[int, _Asked | None](), count()  # None: begun early
        self.early = dict[str, int]()  # tags by digest
        self._finished = dict[int, Outcome]()  # of these
        self._ahead: deque[Scene] | None = None  # to be begun early; None where the strategy has to be asked
        self._told = self._errors = 0  # rollouts of which the strategy knows; errors in a row
        self._most = self.manifest.budget
        goes_on = self.more or (self.past.left and store.rollouts(run) > self.manifest.budget)
        self._conclude = getattr(strategy, "conclude", None) if goes_on else None
        status: Status = "failed"
        try:
            for number, outcome in self.executor.run(self._scenes()):
                if asked := self._running.pop(number):
                    self._take(asked, outcome)
                else:
                    self._finished[number] = outcome
            if self._todo:
                raise TimeOverError
            self.past.check_empty()
            status = "stopped" if self.tally.stopped else "finished"
        except TimeOverError:
            status, self.tally.stopped = "interrupted", self.tally.stopped or TIME_OVER
        except (KeyboardInterrupt, PolicyError):
            status = "interrupted"
            raise
        finally:
            store.finish(run, status, self.tally.seconds)
            if looks_for_causes(strategy) and not self.past.left:
                self._keep_causes()
        return self.tally.summary(str(store.path))

    def _follow(self) -> None:
        """Tell the watch, and now and then keep the causes so far for those who follow the run."""
        self.watch(self.tally)
        began = time.monotonic()
        if self.tally.causes is not None and began >= self._due:
            self._keep_causes()
            self._due = began + max(EVERY, (time.monotonic() - began) / SHARE)

    def _keep_causes(self) -> None:
        run = self.tally.run
        self.store.keep_causes(run, attribution(self.strategy, self.space, self.store, run))

    def _scenes(self) -> Iterator[tuple[int, Scene] | None]:
        """Scenes as they are proposed; None when outcomes are needed before there are more."""
        while True:
            self._ask()
            while self._tell():  # one group at a time, so that what is asked when is always the same
                self._ask()
            if self._todo and self.deadline.passed:
                return
            if self._todo:
                asked = self._todo.popleft()
                tag = next(self._tags)
                self._running[tag] = asked
                yield tag, asked.scene
            elif self._awaited:
                yield self._early()
            else:
                return

    def _early(self) -> tuple[int, Scene] | None:
        """A scene that is likely to be proposed, with its tag; None if none is known."""
        if not hasattr(self.strategy, "ahead") or self.tally.stopped or self.past.left or self.deadline.passed:
            return None
        if self._ahead is None:
            number = min(AHEAD * self.manifest.batch, self._affordable())
            self._ahead = deque(map(self._decode, self.strategy.ahead(number)))
        while self._ahead:
            scene = self._ahead.popleft()
            if scene.digest not in self.early and self._known(scene) is None:
                tag = self.early[scene.digest] = next(self._tags)
                self._running[tag] = None
                return tag, scene
        return None

    def _ask(self) -> None:
        while (room := self._room()) > 0:
            proposals = self.strategy.ask(room)
            if len(proposals) > room:  # a user's own strategy may, but the budget holds
                name = self.manifest.strategy
                problem = f"strategy {name!r}: asked for {room} proposals, got {len(proposals)}"
                raise UsageError(problem, hint="give at most as many")
            if not proposals:
                return
            self._admit(proposals)

    def _room(self) -> int:
        """The number of proposals to ask for now."""
        manifest, awaited = self.manifest, len(self._awaited)
        if self.tally.stopped or (awaited and not overlaps(self.strategy)):
            return 0
        if self._affordable() <= 0 and not awaited and self._conclude:
            self._conclude()
            self._conclude, more = None, self.more or self.past.left + manifest.batch * manifest.repeats
            self._most = self._told + more
        room = min(manifest.batch - awaited, self._affordable())
        return min(room, 1) if overlaps(self.strategy) else room

    def _affordable(self) -> int:
        return (self._most - self._told) // self.manifest.repeats - len(self._awaited)

    def _admit(self, proposals: Sequence[Proposal]) -> None:
        """Answer proposals from the store, or from those that are awaited; evaluate the others."""
        scenes = [self._decode(proposal.genome) for proposal in proposals]
        past = self.past.take(proposals, scenes)
        for trial in past.values():
            self.tally.count(trial)
        if past and not self.past.left:
            self._follow()
        by_scene = {asked.scene.digest: asked for asked in self._awaited if asked.same is None}
        for index, (proposal, scene) in enumerate(zip(proposals, scenes, strict=True)):
            asked = _Asked(proposal, scene, same=by_scene.get(scene.digest))
            self._awaited.append(asked)
            if (known := past.get(index)) is not None:
                asked.outcome, asked.duplicate = known.outcome, known.duplicate
                asked.kept, asked.same = True, None
            elif asked.same is None:
                asked.outcome = self._known(scene)
                asked.duplicate = asked.outcome is not None
                if asked.outcome is None:
                    self._begin(asked)
            by_scene.setdefault(scene.digest, asked)

    def _decode(self, genome: Genome) -> Scene:
        return self.scenes[int(genome[0])] if self.scenes else self.space.decode(genome)

    def _known(self, scene: Scene) -> Outcome | None:
        return self.store.known(scene, self.manifest.key(), self.tally.run if self.alone else None)

    def _begin(self, asked: _Asked) -> None:
        """Have a scene rolled out, unless it was begun early."""
        tag = self.early.pop(asked.scene.digest, None)
        if tag is None:
            self._todo.append(asked)
        elif tag in self._running:
            self._running[tag] = asked
        else:
            self._take(asked, self._finished.pop(tag))

    def _tell(self) -> bool:
        """Tell the strategy about what it proposed first, if that is settled; whether it is."""
        group = list(islice(self._awaited, 1 if overlaps(self.strategy) else None))
        if not group or not all(asked.settled for asked in group):
            return False
        for asked in group:
            self._awaited.popleft()
            if not asked.kept:
                asked.duplicate = True
                self._keep(asked)
        self._learn(group)
        return True

    def _learn(self, group: Sequence[_Asked]) -> None:
        self._ahead = None
        scenes, outcomes = [asked.scene for asked in group], [asked.result for asked in group]
        self._told += sum(len(asked.result.rollouts) for asked in group if not asked.duplicate)
        if not self.tally.stopped:
            self.tally.judge(scenes, outcomes, self.patience)
        self.strategy.tell([self._tried(asked) for asked in group], [self._score(asked) for asked in group])
        if looks_for_causes(self.strategy):
            found = said_by(self.strategy, "found", None)
            self.tally.causes = len(said_by(self.strategy, "causes", ())) if found is None else found

    def _score(self, asked: _Asked) -> Score:
        if asked.score is None:
            asked.score = score(asked.scene, asked.result, self.space)
        return asked.score

    def _tried(self, asked: _Asked) -> Proposal:
        """The proposal without the events that had not begun, as they explain no failure."""
        scene = came_about(asked.scene, asked.result)
        if scene is asked.scene or self.scenes:
            return asked.proposal
        return replace(asked.proposal, genome=self.space.nearest(scene))

    def _take(self, asked: _Asked, outcome: Outcome) -> None:
        """Store a trial, and end the run where nothing but errors is to be expected; resuming forgets the last ones.

        Raises:
            PolicyError: the policy no longer answers.
            TimeOverError: other errors, but for those in the scenes of a file.
        """
        asked.outcome = outcome
        self._keep(asked)
        if outcome.verdict is Verdict.ERROR:
            self._errors += 1
        elif outcome.judged:  # in an unfair scene the policy was not asked
            self._errors = 0
        if self._errors == GONE and outcome.unanswered:
            problem = f"{GONE} scenes in a row had no answer: {outcome.detail}"
            raise PolicyError(problem, hint="repeat the command once the policy answers", cause="connect")
        if self._errors >= GONE and self.patience is not None:
            self.tally.stopped = f"{GONE} scenes in a row ended in an error, the last: {outcome.detail}"
            raise TimeOverError

    def _keep(self, asked: _Asked) -> None:
        scored = self._score(asked)
        trial = Trial(
            proposal=asked.proposal.id,
            scene=asked.scene,
            outcome=asked.result,
            severity=scored.severity,
            genome=asked.proposal.genome,
            cell=scored.cell,
            duplicate=asked.duplicate,
        )
        asked.kept = True
        self.store.add(self.tally.run, trial)
        self.tally.count(trial)
        self._follow()
