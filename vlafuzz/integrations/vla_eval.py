"""A corpus as a benchmark of vla-eval: any model that vla-eval serves is run in the scenes of a corpus.

A file for ``vla-eval run --config FILE`` (written to vla-eval 0.8.0, installed beside vlafuzz)::

    server: {url: "ws://127.0.0.1:8000"}
    benchmarks:
      - benchmark: "vlafuzz.integrations.vla_eval:Corpus"
        params: {corpus: mini-pick-up, camera: 128, relative_to: current}

``params`` are ``corpus`` and the options that vlafuzz's own names of vla-eval servers have; `vlafuzz serve`
prints those of its policy. Every scene that `vlafuzz regress` runs is a task, named by its digest; its suite
is ``failing``, ``counterpart`` or ``nominal``, and ``tasks: [failing]`` runs those alone. More than one
episode a task is for stochastic models. A scene that is not fair any more is an error, not a failure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

import numpy as np
from numpy.typing import NDArray
from vla_eval.benchmarks.base import StepBenchmark, StepResult
from vla_eval.render import configure_sapien_render
from vla_eval.specs import DimSpec

from vlafuzz.clients.layouts import LAYOUTS
from vlafuzz.clients.remote import parse
from vlafuzz.clients.vla_eval import PROTOCOL_VERSION, VlaEval, message_of
from vlafuzz.clients.vla_eval_spec import (
    Hello,
    declared_actions,
    declared_observations,
    layout_of,
    spec_of,
)
from vlafuzz.clients.wire import actions_of
from vlafuzz.conditions.packs import stored_catalogue
from vlafuzz.errors import PolicyError, SceneError, UsageError
from vlafuzz.policies.base import Observation
from vlafuzz.policies.harness import Harness
from vlafuzz.regression.folder import read_corpus
from vlafuzz.regression.pairs import probes
from vlafuzz.rigs.robots import rig
from vlafuzz.store.records import Manifest
from vlafuzz.triage.witness import Player

if TYPE_CHECKING:  # the renderer is chosen before anything loads it
    from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator

NAME = "vla-eval"  # in messages
IDLE = {"batch", "deterministic", "timeout"}  # options that are vla-eval's business here
LAVAPIPE = "VLAFUZZ_LAVAPIPE_ICD"  # names the driver for ``render: cpu`` where vla-eval does not find it


class Corpus(StepBenchmark):
    """The scenes of a corpus.

    Args:
        corpus: folder that `vlafuzz export --minimal` wrote, or the name of a shipped one.
        send_state: whether proprioception is sent where the option ``state`` says nothing; most servers
            declare it, as they do ``send_wrist_image``.
        options: how the model's cameras and actions are, as in ``vlafuzz.clients.remote.Options``.

    Raises:
        CorpusError: it is no such folder, or is damaged.
        UsageError: no such option, or a pack of the corpus's objects is gone.
    """

    render_backends = frozenset({"gpu", "cpu"})

    def __init__(
        self, corpus: str, *, send_state: bool = False, send_wrist_image: bool = False, **options: object
    ) -> None:
        super().__init__()
        if idle := sorted(IDLE & options.keys()):
            raise UsageError(f"params: {idle[0]}: means nothing here", hint="leave it out")
        said = parse(f"{NAME}:ws://server:1?{urlencode(options)}", VlaEval).options
        hello = Hello(
            protocol_version=PROTOCOL_VERSION,
            observation_params={"send_state": send_state, "send_wrist_image": send_wrist_image},
        )
        self.spec, self._layout = spec_of(NAME, hello, said), layout_of(NAME, hello, said)
        self._bundle = read_corpus(Path(corpus))
        self._probes = {probe.scene.digest: probe for probe in probes(self._bundle)}
        self._catalogue = stored_catalogue(*self._bundle.runs)
        self._player = Player(self.spec)
        self._player.spec = replace(self.spec, execute=1)
        self._evaluators: dict[tuple[object, ...], ManiSkillEvaluator] = {}  # by conditions

    @classmethod
    def configure_render(cls, mode: str) -> dict[str, str]:
        """See vla-eval's ``Benchmark``: on a GPU where there is one, or with ``render: cpu`` on lavapipe."""
        return dict(configure_sapien_render(mode, LAVAPIPE))

    def get_tasks(self) -> list[dict[str, Any]]:
        """One a scene."""
        return [
            {
                "name": digest,
                "suite": probe.group,
                "task": self._bundle.task,
                "what": probe.what,
                "instruction": probe.scene.instruction,
                "seed": self._bundle.runs[probe.run].seed,
            }
            for digest, probe in self._probes.items()
        ]

    def reset(self, task: dict[str, Any]) -> Observation:
        """Build a scene. The n-th episode has a seed that is n more, as a repeat of `vlafuzz regress` has.

        Raises:
            SceneError: it is not fair.
        """
        probe = self._probes[task["name"]]
        run = self._bundle.runs[probe.run]
        task["seed"] = run.seed + task.get("episode_idx", 0)  # the runner sends the task after this
        with self._renewed_after_errors():
            evaluator = self._evaluator(run)
            if rejection := evaluator.check(probe.scene):
                raise SceneError(f"{task['name']}: not fair: {rejection.check}: {rejection.reason}")
            self._episode = evaluator.begin(probe.scene, task["seed"])
            self._harness = Harness(self._player, self._episode.start)
            return self._episode.observe()

    def step(self, action: Mapping[str, Any]) -> StepResult:
        """Execute an action ``(7,)``, or a chunk ``(steps, 7)`` up to what the option ``execute`` says.

        Raises:
            PolicyError: it is none.
        """
        self._player.actions = _chunk(action)[: self.spec.execute]
        with self._renewed_after_errors():
            for number in range(len(self._player.actions)):
                if not self._episode.over:
                    self._episode.advance(self._harness.action(partial(self._asked, number)))
            over = self._episode.over
            return StepResult(None if over else self._episode.observe(), 0.0, over, {})

    def make_obs(self, raw_obs: Observation, task: dict[str, Any]) -> dict[str, Any]:
        """As vlafuzz itself sends it."""
        return message_of(raw_obs, self.spec.cameras, LAYOUTS.get(self._layout or ""))

    def get_step_result(self, step_result: StepResult) -> dict[str, Any]:
        """Success as vlafuzz judges it, and how far it came."""
        rollout = self._episode.rollout()
        return {
            "success": rollout.success_once,
            "success_at_end": rollout.success_at_end,
            "progress": rollout.progress,
        }

    def get_metric_keys(self) -> dict[str, str]:
        """All of them are means."""
        return dict.fromkeys(("success", "success_at_end", "progress"), "mean")

    def get_metadata(self) -> dict[str, Any]:
        """The most steps: all of a rollout, one action at a time."""
        rigs = [rig(probe.scene.robot) for probe in self._probes.values()]
        hz = self.spec.action.hz
        return {"max_steps": max(each.seconds * (each.control_hz or hz) for each in rigs)}

    def get_action_spec(self) -> dict[str, DimSpec]:
        """What the options say."""
        return _specs(declared_actions(self.spec.action))

    def get_observation_spec(self) -> dict[str, DimSpec]:
        """What the options ask for."""
        return _specs(declared_observations(self.spec.cameras, self._layout))

    def cleanup(self) -> None:
        """Let go of the simulator."""
        for evaluator in self._evaluators.values():
            evaluator.close()

    @contextmanager
    def _renewed_after_errors(self) -> Iterator[None]:
        """Only a rebuilt environment is clean after an exception."""
        try:
            yield
        except Exception:
            for evaluator in self._evaluators.values():
                evaluator.renew()
            raise

    def _evaluator(self, run: Manifest) -> ManiSkillEvaluator:
        """What a scene is rolled out with under the conditions of a run."""
        from vlafuzz.sim.maniskill.evaluator import ManiSkillEvaluator

        if run.conditions not in self._evaluators:
            self._evaluators[run.conditions] = ManiSkillEvaluator(
                run.task,
                self._player,
                self._catalogue,
                min_distance=run.min_distance,
                stop_early=run.stop_early,
                criteria=run.criteria,
                placement=run.placement,
            )
        return self._evaluators[run.conditions]

    def _asked(self, number: int) -> Observation:
        """For the player, who only wants to know which action of the chunk it is."""
        return Observation(self._episode.start.episode, number, self._episode.instruction)


def _chunk(action: Mapping[str, Any]) -> NDArray[np.float64]:
    try:
        return actions_of(action)
    except ValueError as error:
        raise PolicyError(f"{NAME}: {error}", cause="bad_action") from None


def _specs(declared: Mapping[str, Mapping[str, Any]]) -> dict[str, DimSpec]:
    return {name: DimSpec.from_dict(told) for name, told in declared.items()}
