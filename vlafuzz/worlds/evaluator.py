"""Evaluators: scenes in, outcomes out. What all worlds have in common checks scenes and runs a policy in them."""

import time
from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Protocol, TypedDict, TypeVar, cast

from vlafuzz.errors import PolicyError, PrerequisiteError, UsageError
from vlafuzz.model import Conditions, Outcome, Rejection, Rollout, Scene
from vlafuzz.policies.base import ActionChunk, CameraRequest, Observation, Policy
from vlafuzz.policies.clients import wire
from vlafuzz.policies.harness import Harness, ask, release
from vlafuzz.worlds.episode import Episode
from vlafuzz.worlds.recording import Paths, Recording

FRAMES = 5  # of a film, for a second of the rollout, at least
FILMED = 80  # frames of a rollout that lasts as long as it may, at least: 16 seconds of the tabletop
BLANK = 0.5  # of the pixels; with mini's light at six times the usual 91 to 96 % are white, at 3.6 times 1 %
FILM_SPEED = 3  # times real time: a failing rollout takes 16 seconds
Seeded = Scene | tuple[Scene, int]  # a scene, perhaps with the seed of its rollout; else that of the conditions
T = TypeVar("T")
Asking = Generator[Observation | float, ActionChunk | None, T]
Evaluation = Asking[Outcome]
"""The evaluation of one scene. It yields an observation where the policy must act, and is sent the chunk, or
thrown the PolicyError; or it yields a pause in seconds. It returns the outcome."""


@dataclass(frozen=True, eq=False)
class Film:
    """A recorded rollout.

    Attributes:
        video: MP4 of ``frames`` frames, ``rate`` of them a second.
        still: JPEG of the moment that tells most: where a failure makes no progress any more, or at success.
        moment: the frame of the still.
        stages: that were reached, each with its frame.
        lost: the stage that was not reached, of a failure; empty in a task whose only stage is success.
        greys: see ``Recording.greys``.
        size: width and height of a frame in pixels; ``paths``: of the hand, see ``Recording.paths``.
    """

    video: bytes
    still: bytes
    failed: bool
    _: KW_ONLY
    frames: int = 1
    rate: float = FRAMES * FILM_SPEED
    moment: int = 0
    stages: tuple[tuple[str, int], ...] = ()
    lost: str = ""
    greys: tuple[float, ...] = ()
    size: tuple[int, int] = (1, 1)
    paths: Paths = ()

    @property
    def blank(self) -> str:
        """``white`` or ``black`` where half of what the policy sees first is as good as that, else empty."""
        if not self.greys or max(self.greys[0], self.greys[-1]) < BLANK:
            return ""
        return "white" if self.greys[-1] >= BLANK else "black"


class Evaluator(Protocol):
    """Runs a policy in scenes. A crash in a scene is not raised, it results in an ERROR outcome."""

    def evaluate(self, scenes: Sequence[Scene]) -> list[Outcome]:
        """One outcome per scene, in order. Earlier scenes have no influence on it."""

    def close(self) -> None:
        """Release simulator and policy."""


def proceed(evaluation: Evaluation, answer: ActionChunk | PolicyError | None) -> Observation | float | Outcome:
    """Resume an evaluation with the policy's answer; None at its start and after a pause."""
    try:
        return evaluation.throw(answer) if isinstance(answer, PolicyError) else evaluation.send(answer)
    except StopIteration as over:
        return cast(Outcome, over.value)


def drive(evaluation: Evaluation, policy: Policy) -> Outcome:
    """The outcome of an evaluation in which this policy acts."""
    asked = proceed(evaluation, None)
    while not isinstance(asked, Outcome):
        answer: ActionChunk | PolicyError | None = None
        if isinstance(asked, float):
            time.sleep(asked)
        else:
            try:
                answer = ask(policy, asked)
            except PolicyError as error:
                answer = error
        asked = proceed(evaluation, answer)
    return asked


class Options(TypedDict, total=False):
    """Holds the options that evaluators of all worlds take: see ``SceneEvaluator``."""

    recording: Recording | None
    checked: bool


class SceneEvaluator(ABC):
    """Runs a policy in scenes of one task.

    Args:
        conditions: all that determines an outcome beside the scene; their ``policy`` is only a name. stages: names of
        the task's stages.
        recording: keeps frames and observations.
        checked: whether validity is checked before a rollout.

    Attributes:
        seed: of the next rollouts; initially that of the conditions.
    """

    def __init__(
        self,
        conditions: Conditions,
        policy: Policy,
        stages: tuple[str, ...],
        *,
        recording: Recording | None = None,
        checked: bool = True,
    ) -> None:
        if conditions.criteria != "strict":
            problem = f"criteria {conditions.criteria}: success is no longer judged as in VLATest's environments"
            raise UsageError(problem, hint="run the scenes anew")
        self._conditions, self._policy, self._stages = conditions, policy, stages
        self._checked, self._recording, self.seed = checked, recording, conditions.seed

    @abstractmethod
    def check(self, scene: Scene) -> Rejection | None:
        """Why a scene is not fair; None if it is."""

    @abstractmethod
    def begin(self, scene: Scene, seed: int) -> Episode:
        """A rollout in a fair scene that has begun."""

    @abstractmethod
    def renew(self) -> None:
        """Use a new environment for the next scene."""

    def leave(self) -> None:  # noqa: B027 - most evaluators keep what they have
        """Leave to other evaluators what a scene has taken; called after each."""

    @property
    def recorded(self) -> CameraRequest | None:
        """The camera of the recording, if it has one."""
        return self._recording.camera if self._recording else None

    def evaluate(self, scenes: Sequence[Seeded]) -> list[Outcome]:
        return [drive(self.evaluation(*(one if isinstance(one, tuple) else (one,))), self._policy) for one in scenes]

    def close(self) -> None:
        self.renew()
        release(self._policy)

    def evaluation(self, scene: Scene, seed: int | None = None) -> Evaluation:
        """The evaluation of a scene; no other may begin before it ends. Only PrerequisiteError is raised.

        ``seed``: of its first rollout; None for that of the conditions.
        """
        try:
            rejection = self.check(scene) if self._checked else None
            if rejection is not None:
                return Outcome.invalid(rejection.check, rejection.reason)
            rollouts: tuple[Rollout, ...] = ()
            first = self.seed if seed is None else seed
            for number in range(first, first + self._conditions.repeats):
                rollouts += ((yield from self._repeated(scene, number)),)
        except PrerequisiteError:
            raise  # other scenes would raise it too
        except PolicyError as error:
            return Outcome.error(f"policy: {error.cause}: {error}", unanswered=error.cause in wire.UNANSWERED)
        except Exception as error:  # a crash of the simulator is not a failure of the policy
            self.renew()  # after an exception only a new environment is clean
            return Outcome.error(f"simulator: {type(error).__name__}: {error}")
        finally:
            self.leave()
        return Outcome.of(rollouts, self._stages)

    def _repeated(self, scene: Scene, seed: int) -> Asking[Rollout]:
        """A rollout, begun again at most twice if the policy's server was lost or too late."""
        for pause in wire.PAUSES:
            try:
                return (yield from self._rollout(scene, seed))
            except PolicyError as error:
                wire.check_repeatable(error, pause, wire.UNANSWERED)
            yield pause
        return (yield from self._rollout(scene, seed))

    def _rollout(self, scene: Scene, seed: int) -> Asking[Rollout]:
        began, recording = time.perf_counter(), self._recording
        if recording is not None:
            recording.clear()
        episode = self.begin(scene, seed)
        harness = Harness(self._policy, episode.start)
        if recording is not None:
            recording.note(episode)
        by_state = None if recording else getattr(self._policy, "by_state", None)
        while not episode.over:
            if by_state is not None:
                actions = by_state(episode.state)
            else:
                observation = episode.observe()
                if recording is not None:
                    recording.observations.append(observation)
                chunk = yield observation
                assert chunk is not None
                actions = harness.actions(chunk)
            for action in actions:
                episode.advance(action)
                if recording is not None:
                    recording.note(episode)
                if episode.over:
                    break  # type: ignore[unreachable] # an action has ended it
        return episode.rollout(time.perf_counter() - began)
