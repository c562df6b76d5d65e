"""A corpus as a benchmark of vla-eval: any model that vla-eval serves is run in the scenes of a corpus.

A file for ``vla-eval run --config FILE`` (written to vla-eval 0.8.0, installed beside vlafuzz)::

    server: {url: "ws://127.0.0.1:8000"}
    benchmarks:
      - benchmark: "vlafuzz.exports.vla_eval:Corpus"
        params: {corpus: mini-pick-up, camera: 128, relative_to: current}

``params`` are ``corpus`` and the options of vlafuzz's ``vla-eval:`` policies; `vlafuzz serve` prints those of the
policy that it serves. Every scene that `vlafuzz regress` runs is a task, named by its digest; its suite is ``failing``,
``counterpart`` or ``nominal``, and ``tasks: [failing]`` runs only that suite. Run more than one episode per task for
stochastic models. A scene that is no longer fair is an error, not a failure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

from vla_eval.benchmarks.base import StepBenchmark, StepResult
from vla_eval.render import configure_sapien_render
from vla_eval.specs import DimSpec

from vlafuzz.errors import PolicyError, SceneError, UsageError
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.failures.corpus.pairs import probes
from vlafuzz.failures.triage.witness import Player
from vlafuzz.policies.base import Observation
from vlafuzz.policies.clients.servers import parse
from vlafuzz.policies.clients.vla_eval import (
    PROTOCOL_VERSION,
    DeclaredModel,
    Hello,
    Parameters,
    VlaEval,
    declared_actions,
    declared_observations,
)
from vlafuzz.policies.clients.wire import actions_of
from vlafuzz.policies.harness import Harness
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.store.records import Manifest
from vlafuzz.worlds import world_of

if TYPE_CHECKING:  # vla-eval chooses the renderer before the simulator is imported
    from vlafuzz.worlds.evaluator import SceneEvaluator

NAME = "vla-eval"  # in messages
UNUSED = {"batch", "deterministic", "timeout"}  # options of the policy that vla-eval itself decides here
LAVAPIPE = "VLAFUZZ_LAVAPIPE_ICD"  # names the driver for ``render: cpu`` where vla-eval does not find it


class CorpusBenchmark(StepBenchmark):
    """The scenes of a corpus as tasks of a vla-eval benchmark.

    Args:
        corpus: folder that `vlafuzz export --minimal` wrote, or the name of a shipped one. send_state: whether to send
        proprioception where the option ``state`` is not given; most servers
            declare this, and ``send_wrist_image``.
        options: the model's cameras and action conventions, see ``policies.clients.options.VlaEvalOptions``.

    Raises:
        CorpusError: the folder is not a corpus, or is damaged.
        UsageError: an option is unknown, or an object pack of the corpus is missing.
    """

    render_backends = frozenset({"gpu", "cpu"})

    def __init__(
        self, corpus: str, *, send_state: bool = False, send_wrist_image: bool = False, **options: object
    ) -> None:
        super().__init__()
        if unused := sorted(UNUSED & options.keys()):
            raise UsageError(f"params: {unused[0]}: has no effect here", hint="leave it out")
        parsed = parse(f"{NAME}:ws://server:1?{urlencode(options)}", VlaEval).options
        hello = Hello(
            protocol_version=PROTOCOL_VERSION,
            observation_params=Parameters(send_state=send_state, send_wrist_image=send_wrist_image),
        )
        self._model = DeclaredModel(NAME, hello, parsed)
        self.spec = self._model.spec
        self._corpus = read_corpus(Path(corpus))
        self._probes = {probe.scene.digest: probe for probe in probes(self._corpus)}
        self._player = Player(self.spec)
        self._player.spec = replace(self.spec, execute=1)
        self._evaluators: dict[str, SceneEvaluator] = {}  # by conditions

    @classmethod
    def configure_render(cls, mode: str) -> dict[str, str]:
        """See vla-eval's ``Benchmark``: render on a GPU if there is one, with ``render: cpu`` on lavapipe."""
        return dict(configure_sapien_render(mode, LAVAPIPE))

    def get_tasks(self) -> list[dict[str, Any]]:
        return [
            {
                "name": digest,
                "suite": probe.group,
                "task": self._corpus.task,
                "what": probe.what,
                "instruction": probe.scene.instruction,
                "seed": self._corpus.runs[probe.run].seed,
            }
            for digest, probe in self._probes.items()
        ]

    def reset(self, task: dict[str, Any]) -> Observation:
        """Build a fair scene; the n-th episode adds n to the seed."""
        probe = self._probes[task["name"]]
        run = self._corpus.runs[probe.run]
        task["seed"] = run.seed + task.get("episode_idx", 0)  # the runner sends the task after this
        with self._renewed_after_errors():
            evaluator = self._evaluator(run)
            if rejection := evaluator.check(probe.scene):
                raise SceneError(f"{task['name']}: not fair: {rejection.check}: {rejection.reason}")
            self._episode = evaluator.begin(probe.scene, task["seed"])
            self._harness = Harness(self._player, self._episode.start)
            return self._episode.observe()

    def step(self, action: Mapping[str, Any]) -> StepResult:
        """Execute an action ``(7,)``, or the first ``execute`` (an option) of a chunk ``(steps, 7)``."""
        try:
            self._player.actions = actions_of(action)[: self.spec.execute]
        except ValueError as error:
            raise PolicyError(f"{NAME}: {error}", cause="bad_action") from None
        with self._renewed_after_errors():
            for number in range(len(self._player.actions)):
                if not self._episode.over:
                    self._episode.advance(self._harness.action(partial(self._observation, number)))
            over = self._episode.over
            return StepResult(None if over else self._episode.observe(), 0.0, over, {})

    def make_obs(self, raw_obs: Observation, task: dict[str, Any]) -> dict[str, Any]:
        """The same message that vlafuzz sends to a vla-eval server."""
        return self._model.message(raw_obs)

    def get_step_result(self, step_result: StepResult) -> dict[str, Any]:
        """Success as vlafuzz judges it, and progress."""
        rollout = self._episode.rollout()
        success = {"success": rollout.success_once, "success_at_end": rollout.success_at_end}
        return success | {"progress": rollout.progress}

    def get_metric_keys(self) -> dict[str, str]:
        return dict.fromkeys(("success", "success_at_end", "progress"), "mean")

    def get_metadata(self) -> dict[str, Any]:
        """The most steps an episode can take, with one action per step."""
        scenes = [probe.scene for probe in self._probes.values()]
        robots = [world_of(scene.task).robot(scene.robot) for scene in scenes]
        hz = self.spec.action.hz
        return {"max_steps": max(robot.seconds * (robot.control_hz or hz) for robot in robots)}

    def get_action_spec(self) -> dict[str, DimSpec]:
        return _specs(declared_actions(self.spec.action))

    def get_observation_spec(self) -> dict[str, DimSpec]:
        return _specs(declared_observations(self.spec.cameras, self._model.layout))

    def cleanup(self) -> None:
        for evaluator in self._evaluators.values():
            evaluator.close()

    @contextmanager
    def _renewed_after_errors(self) -> Iterator[None]:
        """After an exception, rebuild the environments: their state is undefined."""
        try:
            yield
        except Exception:
            for evaluator in self._evaluators.values():
                evaluator.renew()
            raise

    def _evaluator(self, run: Manifest) -> SceneEvaluator:
        key = run.key(seeded=False)
        if key not in self._evaluators:
            once = replace(run, repeats=1)
            self._evaluators[key] = make_evaluator(once, self._player)
        return self._evaluators[key]

    def _observation(self, number: int) -> Observation:
        """For the player, which only reads the action's number in the chunk."""
        return Observation(self._episode.start.episode, number, self._episode.instruction)


Corpus = CorpusBenchmark  # the public name: users' YAML files have "vlafuzz.exports.vla_eval:Corpus"


def _specs(declared: Mapping[str, Mapping[str, Any]]) -> dict[str, DimSpec]:
    return {name: DimSpec.from_dict(dimension) for name, dimension in declared.items()}
