"""Scene runners: policy, expert and simulator under the conditions of a run, for work after it."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from vlafuzz.common.plugins import check_trusted
from vlafuzz.model import Actions, Conditions, Outcome, Scene, Solver, Space, Verdict
from vlafuzz.policies.base import Policy
from vlafuzz.policies.controls import Player
from vlafuzz.rollouts.executor import Executor, LocalExecutor, Tagged, evaluate_safely
from vlafuzz.rollouts.lockstep import LockstepExecutor, lanes_for
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.rollouts.setup import here, make_evaluator
from vlafuzz.worlds import world_of
from vlafuzz.worlds.evaluator import FILM_SPEED, FILMED, FRAMES, Film, SceneEvaluator
from vlafuzz.worlds.provenance import elsewhere
from vlafuzz.worlds.recording import Recording, to_jpeg, to_mp4

_ROUNDED = 1e-5  # of progress, which is kept as 32-bit floats


class SceneRunner(Protocol):
    """Runs policy and expert in scenes under the conditions of one run. Nothing raises for what a scene does.

    ``stages``: names of the task's. ``renderer``: what renders the policy's images; None for a policy without cameras.
    """

    stages: tuple[str, ...]
    deterministic: bool
    renderer: str | None

    @property
    def space(self) -> Space:
        """The search space with the operators of the run."""

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        """One rollout in each scene, with the runner's seed plus the scene's number."""

    def solve(self, scene: Scene, attempt: int, solver: Solver = "expert") -> Outcome:
        """One rollout of the expert or the seeing expert, in its n-th attempt."""

    def play(self, scene: Scene, actions: Actions) -> Outcome:
        """The outcome when the robot executes these actions."""

    def close(self) -> None:
        """Release simulator and policies."""


class SimulatorSceneRunner:
    """A ``SceneRunner`` with a simulator, which takes seconds to make.

    Args:
        source: store or corpus that the conditions are from, for messages.
        policy: another policy than the run's, by name, or the run's own where that is an object.

    Raises:
        UsageError: the run's policy is code that the user did not name, see ``check_trusted``.

    ``lanes``: scenes at a time. ``changed``: names of the conditions that come with the installation and were others in
    the run. ``elsewhere``: where the run was made, in words; empty if it was made here.
    """

    def __init__(self, source: Path, conditions: Conditions, policy: Policy | str | None = None) -> None:
        if policy is None:
            check_trusted(conditions.policy)
        self.space = world_of(conditions.task).stored_space(source, conditions)
        self.stages = self.space.task.stage_names
        name = policy if isinstance(policy, str) else conditions.policy
        self._policy = make_policy(name, conditions.task) if policy is None or isinstance(policy, str) else policy
        self._conditions = conditions
        self._world = world_of(conditions.task)
        self._solvers = self._world.solvers()
        self._player = Player(self._solvers["expert"].spec)
        spec = self._policy.spec
        self.deterministic = spec.deterministic and conditions.repeats == 1
        # Of a stochastic policy the run's own seeds are left out: with them it fails, that is known.
        self._seed = conditions.seed + (0 if self.deterministic else conditions.repeats)
        self.renderer = self._world.renderer() if spec.cameras else None
        now = replace(conditions, **here(name, self._policy, self.space))
        self.changed = tuple(name for name in conditions.differences(now) if name != "place")
        self.elsewhere = elsewhere(conditions.place, now.place)
        # By whether given actions are played
        self._filmed: dict[bool, tuple[SceneEvaluator, Recording]] = {}
        self.lanes = lanes_for(self._policy)
        alone = LocalExecutor(self._evaluator(self._policy)) if self.lanes == 1 else None
        self._executor: Executor = alone or LockstepExecutor(self._evaluator, self._policy, self.lanes)
        # Whether targets are visible was judged for the policy, which may see outlines instead of pictures.
        self._experts = {name: self._evaluator(solver, unseen=True) for name, solver in self._solvers.items()}
        self._players = self._evaluator(self._player, checked=False)  # the expert's rollout was

    def _evaluator(
        self, of: Policy, *, checked: bool = True, recording: Recording | None = None, unseen: bool = False
    ) -> SceneEvaluator:
        once = replace(self._conditions, repeats=1)
        if unseen:
            once = once.without("visible")
        return make_evaluator(once, of, space=self.space, checked=checked, recording=recording)

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        outcomes = dict(self.run(enumerate(zip(scenes, numbers, strict=True))))
        return [outcomes[index] for index in range(len(scenes))]

    def run(self, scenes: Tagged) -> Iterator[tuple[int, Outcome]]:
        """See ``Executor``; of scenes with the numbers of their rollouts, as many at a time as there are lanes."""
        return self._executor.run(one and (one[0], (one[1][0], self._seed + one[1][1])) for one in scenes)

    def solve(self, scene: Scene, attempt: int, solver: Solver = "expert") -> Outcome:
        if solver not in self._solvers:
            return Outcome.invalid("semantic", f"there is no {solver} expert in this world")
        self._solvers[solver].attempt = attempt
        return evaluate_safely(self._experts[solver], scene)

    def play(self, scene: Scene, actions: Actions) -> Outcome:
        self._player.actions = actions
        return evaluate_safely(self._players, scene)

    def film(self, scene: Scene, actions: Actions | None = None) -> Film | str:
        """What the policy does in a fair scene, or the robot that executes actions; else why there is none."""
        played = actions is not None
        of: Policy = self._player if played else self._policy
        robot = self._world.robot(scene.robot)
        hz = robot.control_hz or of.spec.action.hz
        stride = max(1, round(hz / max(FRAMES, FILMED / robot.seconds)))
        if played not in self._filmed:
            recording = Recording(224, stride=stride)
            self._filmed[played] = self._evaluator(of, checked=False, recording=recording), recording
        evaluator, recording = self._filmed[played]
        if actions is not None:
            self._player.actions = actions
        outcome = evaluate_safely(evaluator, scene)
        if not outcome.rollouts:
            return outcome.detail
        rate = hz / stride * FILM_SPEED
        (rollout, *_), frames = outcome.rollouts, recording.frames
        stages = tuple(
            (stage, recording.frame_after(int(reached[0]) + 1))
            for number, stage in enumerate(self.stages, start=1)
            if len(reached := np.flatnonzero(rollout.trace >= number / len(self.stages) - _ROUNDED))
        )
        failed = outcome.verdict is Verdict.FAILED
        moment = recording.stuck(rollout.trace) if failed or not stages else stages[-1][1]
        return Film(
            to_mp4(frames, rate),
            to_jpeg(frames[moment]),
            failed,
            frames=len(frames),
            rate=rate,
            moment=moment,
            stages=stages,
            lost=outcome.lost_stage or "" if len(self.stages) > 1 else "",
            greys=recording.greys(),
            size=(frames[0].shape[1], frames[0].shape[0]),
            paths=recording.paths(),
        )

    def close(self) -> None:
        self._executor.close()
        for evaluator, _ in self._filmed.values():
            evaluator.renew()  # policy and player are closed below
        for evaluator in (*self._experts.values(), self._players):
            evaluator.close()
