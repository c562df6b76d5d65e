"""SimulatorSceneRunner: policy, expert and simulator under the conditions of a run, for work after it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from vlafuzz.common.plugins import check_trusted
from vlafuzz.common.watch import Watch
from vlafuzz.errors import PrerequisiteError
from vlafuzz.failures.triage.witness import Player
from vlafuzz.model.evidence import Actions, Solver
from vlafuzz.model.outcome import Outcome, Verdict
from vlafuzz.model.scene import Scene
from vlafuzz.policies.base import Policy
from vlafuzz.rollouts.executor import evaluate_safely
from vlafuzz.rollouts.lockstep import LockstepExecutor, Results, Seeded, lanes_for
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.rollouts.setup import here, make_evaluator, stored_space
from vlafuzz.store.records import Manifest, Run
from vlafuzz.worlds import world_of
from vlafuzz.worlds.evaluator import FILM_SPEED, FRAMES, Film
from vlafuzz.worlds.place import elsewhere

if TYPE_CHECKING:
    from vlafuzz.worlds.evaluator import SceneEvaluator
    from vlafuzz.worlds.recording import Recording


class SimulatorSceneRunner:
    """A ``SceneRunner`` with a simulator, which takes seconds to make.

    Args:
        source: store or corpus that the manifest is from, for messages.
        policy: another policy than the run's, by name, or the run's own where that is an object.

    Raises:
        UsageError: the run's policy is code that the user did not name, see ``check_trusted``.

    Attributes:
        lanes: scenes that are rolled out at a time.
        changed: names of the conditions that come with the installation and are not as they were in the run. elsewhere:
        where the run was made, in words; empty if it was made here.
    """

    def __init__(self, source: Path, manifest: Manifest, policy: Policy | str | None = None) -> None:
        if policy is None:
            check_trusted(manifest.policy)
        self.space = stored_space(source, manifest)
        self.stages = self.space.task.stage_names
        name = policy if isinstance(policy, str) else manifest.policy
        self._policy = make_policy(name) if policy is None or isinstance(policy, str) else policy
        self._manifest = manifest
        self._world = world_of(manifest.task)
        self._solvers = self._world.solvers()
        self._player = Player(self._solvers["expert"].spec)
        spec = self._policy.spec
        self.deterministic = spec.deterministic and manifest.repeats == 1
        # Of a stochastic policy the run's own seeds are left out: with them it fails, that is known.
        self._seed = manifest.seed + (0 if self.deterministic else manifest.repeats)
        self.renderer = self._world.renderer() if spec.cameras else None
        now = replace(manifest, **here(name, self._policy, self.space))
        self.changed = tuple(name for name in manifest.differences(now) if name != "place")
        self.elsewhere = elsewhere(manifest.place, now.place)
        self._stills: SceneEvaluator | None = None
        # By whether given actions are played
        self._filmed: dict[bool, tuple[SceneEvaluator, Recording]] = {}
        self._policies = self._evaluator(self._policy)
        self.lanes = lanes_for(self._policy)
        self._lockstep = LockstepExecutor(self._evaluator, self._policy, self.lanes)
        # Whether targets are visible was judged for the policy, which may see outlines instead of pictures.
        self._experts = {name: self._evaluator(solver, unseen=True) for name, solver in self._solvers.items()}
        self._players = self._evaluator(self._player, checked=False)  # the expert's rollout was

    def _evaluator(
        self, of: Policy, *, checked: bool = True, recording: Recording | None = None, unseen: bool = False
    ) -> SceneEvaluator:
        once = replace(self._manifest, repeats=1)
        if unseen:
            once = once.without("visible")
        return make_evaluator(once, of, space=self.space, checked=checked, recording=recording)

    def renew(self) -> None:
        self._policies.renew()

    def evaluate(self, scenes: Sequence[Scene], numbers: Sequence[int]) -> list[Outcome]:
        if self.lanes > 1:
            return self._lockstep.evaluate(scenes, [self._seed + number for number in numbers])
        outcomes: list[Outcome] = []
        for scene, number in zip(scenes, numbers, strict=True):
            self._policies.seed = self._seed + number
            outcomes += evaluate_safely(self._policies, [scene])
        return outcomes

    def rollouts(self, batches: Iterable[Seeded | None]) -> Results:
        """The outcomes of tagged batches of scenes and numbers; see ``LockstepExecutor.run_seeded``."""
        seeded = (batch and (batch[0], batch[1], [self._seed + number for number in batch[2]]) for batch in batches)
        return self._lockstep.run_seeded(seeded)

    def solve(self, scene: Scene, attempt: int, solver: Solver = "expert") -> Outcome:
        if solver not in self._solvers:
            return Outcome.invalid("semantic", f"there is no {solver} expert in this world")
        self._solvers[solver].attempt = attempt
        return evaluate_safely(self._experts[solver], [scene])[0]

    def play(self, scene: Scene, actions: Actions) -> Outcome:
        self._player.actions = actions
        return evaluate_safely(self._players, [scene])[0]

    def picture(self, scene: Scene) -> bytes | None:
        """PNG of a fair scene as the third-person camera sees it; None where nothing can be rendered."""
        from vlafuzz.worlds.recording import Recording, to_png

        try:
            if self._stills is None:
                self._stills = self._evaluator(self._player, checked=False, recording=Recording(256))
            return to_png(self._stills.still(scene))
        except PrerequisiteError:
            return None

    def film(self, scene: Scene, actions: Actions | None = None) -> Film | None:
        """What the policy does in a fair scene, or the robot that executes actions; None if that broke."""
        from vlafuzz.worlds.recording import Recording, to_jpeg, to_mp4

        played = actions is not None
        of: Policy = self._player if played else self._policy
        if played not in self._filmed:
            recording = Recording(224, captions=False, hz=FRAMES)
            self._filmed[played] = self._evaluator(of, checked=False, recording=recording), recording
        evaluator, recording = self._filmed[played]
        if actions is not None:
            self._player.actions = actions
        outcome = evaluate_safely(evaluator, [scene])[0]
        if not outcome.rollouts:
            return None
        hz = min(self._world.robot(scene.robot).control_hz or of.spec.action.hz, FRAMES)
        video = to_mp4(recording.frames, hz * FILM_SPEED)
        return Film(video, to_jpeg(recording.frames[0]), outcome.verdict is Verdict.FAILED)

    def close(self) -> None:
        if self.lanes > 1:
            self._lockstep.close()
        for evaluator in filter(None, (self._stills, *(filmed for filmed, _ in self._filmed.values()))):
            evaluator.renew()  # policy and player are closed below
        for evaluator in (self._policies, *self._experts.values(), self._players):
            evaluator.close()


def runner_of_run(
    store: Path, run: Run, policy: Policy | None = None, *, note: Callable[[str], None] = Watch.note
) -> SimulatorSceneRunner:
    """A scene runner for the findings of a run; notes when it differs from what found them."""
    runner = SimulatorSceneRunner(store, run.manifest, policy=policy)
    verb = "differs" if len(runner.changed) == 1 else "differ"
    version = f"by another version: its {', '.join(runner.changed)} {verb}" if runner.changed else ""
    if how := " and ".join(filter(None, (version, runner.elsewhere))):
        note(f"note: run {run.id} was made {how}; what no longer fails will count as flaky")
    return runner
