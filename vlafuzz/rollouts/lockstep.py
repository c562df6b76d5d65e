"""Lockstep executor: several scenes at a time in this process, so that one call of the policy serves all."""

import time
from collections.abc import Callable, Sequence

from vlafuzz.errors import PolicyError, PrerequisiteError
from vlafuzz.model import Outcome
from vlafuzz.policies.base import ActionChunk, Observation, Policy
from vlafuzz.policies.batching import BatchingPolicy, Request, StandIn
from vlafuzz.policies.harness import release
from vlafuzz.rollouts.executor import broken, checked
from vlafuzz.rollouts.worker_pool import WorkerPool
from vlafuzz.worlds.evaluator import Evaluation, SceneEvaluator, Seeded, proceed


def lanes_for(policy: Policy) -> int:
    """Scenes at a time for a policy: as many as its server batches; one where it answers one by one."""
    return policy.spec.max_batch if getattr(policy, "answers_batches", False) else 1


class LockstepExecutor(WorkerPool):
    """Workers that are lanes in this process, each with a simulator; a scene may have a seed, see ``Seeded``.

    When all lanes wait for the policy, they are answered in one call of it, or in several if they are more than its
    ``max_batch``. A lane that is done takes the next scene at once. Outcomes and trajectories are those of the scenes
    alone, provided that the policy's answers do not depend on its batches.

    Args:
        make: creates a lane's evaluator, when it is needed, from a stand-in for the policy.
        policy: closed with the executor.
        lanes: the largest number of them.
    """

    def __init__(self, make: Callable[[Policy], SceneEvaluator], policy: Policy, lanes: int) -> None:
        self._batching, self._policy = BatchingPolicy(policy), policy
        self._lanes = [_Lane(make, _LanePolicy(number, policy, self._batching)) for number in range(lanes)]
        super().__init__(lambda: self._lanes[len(self._slots)], self._tick, lanes, self._release)

    def _tick(self, lanes: Sequence["_Lane"], _: float) -> None:
        """Resume the lanes whose pause is over, or else those that wait for the policy, unless one is done already."""
        if all(lane.asked is None for lane in lanes):
            raise RuntimeError("there is neither a scene to evaluate nor an outcome to come")
        until = {lane: lane.asked for lane in lanes if isinstance(lane.asked, float)}
        over = [lane for lane in until if until[lane] <= time.monotonic()]
        for lane in over:
            lane.resume(None)
        if over or any(isinstance(lane.asked, Outcome) for lane in lanes):
            return
        acting = [lane for lane in lanes if isinstance(lane.asked, Observation)]
        if not acting:
            time.sleep(max(min(until.values()) - time.monotonic(), 0.0))
        answers = self._batching.answer([lane.request() for lane in acting])
        for lane, answer in zip(acting, answers, strict=True):
            lane.resume(answer if isinstance(answer, PolicyError) else answer[0])

    def _release(self) -> None:
        for lane in self._lanes:
            lane.close()
        release(self._policy)


class _LanePolicy(StandIn):
    """What a lane's evaluator has for a policy: it begins rollouts, and the executor has them answered."""

    def __init__(self, number: int, policy: Policy, batching: BatchingPolicy) -> None:
        super().__init__(policy.spec)
        self.number, self._batching = number, batching

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


class _Lane:
    """A ``Worker`` in this process. ``asked``: what the scene waits for, an answer or a time; then its outcome."""

    def __init__(self, make: Callable[[Policy], SceneEvaluator], policy: _LanePolicy) -> None:
        self._make, self._policy = make, policy
        self._evaluator: SceneEvaluator | None = None
        self._evaluation: Evaluation | None = None
        self.asked: Observation | float | Outcome | None = None

    def ready(self) -> bool:
        return True

    def begin(self, scene: Seeded) -> None:
        self._evaluator = self._evaluator or self._make(self._policy)
        self._evaluation = self._evaluator.evaluation(*(scene if isinstance(scene, tuple) else (scene,)))
        self.resume(None)

    def answer(self) -> Sequence[Outcome]:
        if not isinstance(self.asked, Outcome):
            return ()
        outcome, self.asked = self.asked, None
        return (outcome,)

    def request(self) -> tuple[int, Request]:
        assert isinstance(self.asked, Observation)
        return self._policy.number, self._policy.request(act=[self.asked])

    def resume(self, answer: ActionChunk | PolicyError | None) -> None:
        """Continue to the next question, or to the outcome."""
        assert self._evaluation is not None
        try:
            self.asked = proceed(self._evaluation, answer)
        except PrerequisiteError:
            raise
        except Exception as error:  # a bug in the evaluator must not end a run of hours
            self.asked = broken(error)
        if isinstance(self.asked, Outcome):
            self.asked = checked(self.asked)
            self._policy.flush()
        elif isinstance(self.asked, float):
            self.asked += time.monotonic()

    def kill(self) -> None:
        if self._evaluation is not None:
            self._evaluation.close()
            self._policy.flush()
        self.asked = None

    def close(self) -> None:
        if self._evaluator is not None:
            self._evaluator.close()
