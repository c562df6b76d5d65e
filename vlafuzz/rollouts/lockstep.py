"""Lockstep executor: several scenes at a time in this process, so that one call of the policy serves all."""

import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from typing import cast

from vlafuzz.errors import PolicyError, PrerequisiteError
from vlafuzz.model import Outcome, Scene
from vlafuzz.policies.base import ActionChunk, Observation, Policy
from vlafuzz.policies.batching import BatchingPolicy, Request, StandIn
from vlafuzz.policies.harness import release
from vlafuzz.rollouts.executor import Batches, broken, checked
from vlafuzz.worlds.evaluator import Evaluation, SceneEvaluator, proceed

Seeded = Scene | tuple[Scene, int]  # a scene, perhaps with the seed of its rollout; else that of the conditions


def lanes_for(policy: Policy) -> int:
    """Scenes at a time for a policy: as many as its server batches; one where it answers one by one."""
    return policy.spec.max_batch if getattr(policy, "answers_batches", False) else 1


class LockstepExecutor:
    """An ``Executor`` with several lanes in this process, each with a simulator and one scene at a time.

    When all lanes wait for the policy, they are answered in one call of it, or in several if they are more than its
    ``max_batch``. A lane that is done takes the next scene at once. Outcomes and trajectories are those of the scenes
    alone, provided that the policy's answers do not depend on its batches.

    Args:
        make: creates a lane's evaluator from a stand-in for the policy.
        policy: closed with the executor.
        lanes: the largest number of them; they are created when they are needed.
        eager: after None, batches are pulled again before every call of the policy.
    """

    def __init__(
        self, make: Callable[[Policy], SceneEvaluator], policy: Policy, lanes: int, *, eager: bool = False
    ) -> None:
        self._make, self._policy, self._count, self._eager = make, policy, lanes, eager
        self._batching = BatchingPolicy(policy)
        self._lanes: list[_Lane] = []

    def run(self, batches: Batches) -> Generator[tuple[int, list[Outcome]], None, None]:
        """See ``Executor``; a scene may have a seed, see ``Seeded``."""
        queue = _Queue(batches)
        try:
            while True:
                busy = [lane for lane in self._lanes if lane.job]
                if len(busy) < self._count and (job := queue.next()):
                    self._idle().begin(job)
                elif busy:
                    self._tick(busy)
                    queue.paused = queue.paused and not self._eager
                elif not queue.open and queue.exhausted:
                    return
                elif not queue.open:
                    raise RuntimeError("there is neither a scene to evaluate nor an outcome to come")
                yield from queue.finished()
        finally:
            for lane in self._lanes:
                lane.abandon()

    def close(self) -> None:
        for lane in self._lanes:
            lane.evaluator.close()
        release(self._policy)

    def _idle(self) -> "_Lane":
        for lane in self._lanes:
            if lane.job is None:
                return lane
        policy = _LanePolicy(len(self._lanes), self._policy, self._batching)
        self._lanes.append(_Lane(policy, self._make(policy)))
        return self._lanes[-1]

    def _tick(self, busy: Sequence["_Lane"]) -> None:
        """Resume the lanes whose pause is over, or else those that wait for the policy."""
        acting = [lane for lane in busy if isinstance(lane.asked, Observation)]
        until = {lane: lane.asked for lane in busy if isinstance(lane.asked, float)}
        over = [lane for lane in until if until[lane] <= time.monotonic()]
        for lane in over:
            lane.resume(None)
        if over:
            return
        if not acting:
            time.sleep(max(min(until.values()) - time.monotonic(), 0.0))
        answers = self._batching.answer([lane.request() for lane in acting])
        for lane, answer in zip(acting, answers, strict=True):
            lane.resume(answer if isinstance(answer, PolicyError) else answer[0])


class _LanePolicy(StandIn):
    """What a lane's evaluator has for a policy: it begins rollouts, and the executor has them answered."""

    def __init__(self, number: int, policy: Policy, batching: BatchingPolicy) -> None:
        super().__init__(policy.spec)
        self.number, self._policy, self._batching = number, policy, batching

    def flush(self) -> None:
        """Tell the policy at once which rollouts are over, not only with the next request."""
        if self._over:
            self._answer(self.request())

    def close(self) -> None:
        """Nothing: the executor closes the policy."""

    def _answer(self, request: Request) -> list[ActionChunk]:
        (answer,) = self._batching.answer([(self.number, request)])
        if isinstance(answer, PolicyError):
            raise answer
        return answer


@dataclass(eq=False)
class _Batch:
    """A batch of scenes with the outcomes so far, by the scenes' indices."""

    tag: int
    scenes: Sequence[Seeded]
    outcomes: dict[int, Outcome] = field(default_factory=dict)


_END = (-1, ())  # after the last batch
_Job = tuple[_Batch, int]  # a scene of a batch, by its index


@dataclass(eq=False)
class _Lane:
    """``asked``: what the evaluation waits for, an answer or a time; only while there is a job."""

    policy: _LanePolicy
    evaluator: SceneEvaluator
    job: _Job | None = None
    asked: Observation | float = 0.0
    _evaluation: Evaluation = field(init=False)

    def begin(self, job: _Job) -> None:
        batch, index = job
        scene = batch.scenes[index]
        seeded = scene if isinstance(scene, tuple) else (scene,)
        self.job, self._evaluation = job, self.evaluator.evaluation(*seeded)
        self.resume(None)

    def request(self) -> tuple[int, Request]:
        return self.policy.number, self.policy.request(act=[cast(Observation, self.asked)])

    def resume(self, answer: ActionChunk | PolicyError | None) -> None:
        """Continue to the next question, or to the outcome."""
        assert self.job is not None
        try:
            asked = proceed(self._evaluation, answer)
        except PrerequisiteError:
            raise
        except Exception as error:  # a bug in the evaluator must not end a run of hours
            asked = broken(error)
        if isinstance(asked, Outcome):
            batch, index = self.job
            batch.outcomes[index], self.job = checked(asked), None
            self.policy.flush()
        else:
            self.asked = time.monotonic() + asked if isinstance(asked, float) else asked

    def abandon(self) -> None:
        if self.job is not None:
            self._evaluation.close()
            self.policy.flush()
        self.job = None


class _Queue:
    """Hands out the scenes of batches one by one, and collects the batches whose scenes are all evaluated."""

    def __init__(self, batches: Batches) -> None:
        self._source, self._jobs = iter(batches), deque[_Job]()
        self.open: list[_Batch] = []  # those whose outcomes have not been yielded
        self.exhausted = self.paused = False

    def next(self) -> _Job | None:
        """The next scene; None where there is none for now, or at all."""
        while not self._jobs and not self.exhausted and not self.paused:
            pulled = next(self._source, _END)
            if pulled is _END:
                self.exhausted = True
            elif pulled is None:
                self.paused = True  # until the next outcome
            else:
                self.open.append(_Batch(*pulled))
                self._jobs += [(self.open[-1], index) for index in range(len(self.open[-1].scenes))]
        return self._jobs.popleft() if self._jobs else None

    def finished(self) -> Iterator[tuple[int, list[Outcome]]]:
        for batch in [batch for batch in self.open if len(batch.outcomes) == len(batch.scenes)]:
            self.open.remove(batch)
            self.paused = False
            yield batch.tag, [batch.outcomes[index] for index in range(len(batch.scenes))]
