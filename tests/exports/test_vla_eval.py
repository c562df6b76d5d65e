"""A corpus as a benchmark of the real vla-eval: what it measures is what vlafuzz itself finds."""

import json
import logging
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import vla_eval

from vlafuzz.cli import main
from vlafuzz.common.assets import corpus_dir
from vlafuzz.errors import PolicyError, UsageError
from vlafuzz.exports.vla_eval import CorpusBenchmark
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.failures.corpus.pairs import probes
from vlafuzz.model.conditions import Conditions
from vlafuzz.policies.base import ActionChunk, ActionSpec, EpisodeStart, Observation, PolicySpec
from vlafuzz.policies.serving.serve import serving
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.sim.evaluator import ManiSkillEvaluator

NAME = "vlafuzz.exports.vla_eval:Corpus"  # as users' YAML files have it


class Follower:
    """Follows a course, whatever it sees: four actions at a time, three of them executed. Records seeds."""

    def __init__(self, course: np.ndarray) -> None:
        self.spec = PolicySpec("follower", action=ActionSpec(relative_to="current"), state=True, execute=3)
        self.course, self.seeds = course.astype(np.float64), []

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        self.seeds += [start.seed for start in episodes]
        self._at = 0

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        stay = np.tile([0, 0, 0, 0, 0, 0, self.course[-1, 6]], (4, 1))
        chunk = np.concatenate([self.course[self._at :], stay])[:4]
        self._at += 3
        return [ActionChunk(chunk)]

    def close(self) -> None:
        pass


@pytest.fixture
def follower(corpus: Path) -> Follower:
    return Follower(read_corpus(corpus).cases[0].witness.actions)


def evaluated(url: str, corpus: Path, **more: object) -> dict[str, list[dict[str, object]]]:
    """Metrics of each episode, by task."""
    params = {"corpus": str(corpus), "camera": 0, "relative_to": "current"} | more.pop("params", {})
    config = {"benchmarks": [{"benchmark": NAME, "params": params} | more]}
    (result,) = vla_eval.run(config, server_url=url, no_save=True, docker=False)
    return {task["task"]: [episode["metrics"] for episode in task["episodes"]] for task in result["tasks"]}


def url(name: str) -> str:
    return name.removeprefix("vla-eval:").partition("?")[0]


@pytest.fixture
def log(caplog: pytest.LogCaptureFixture) -> Iterator[pytest.LogCaptureFixture]:
    with caplog.at_level(logging.INFO, "vla_eval"):
        yield caplog


def test_every_scene_comes_out_as_in_process(corpus: Path, follower: Follower, log):
    read = read_corpus(corpus)
    (run,) = read.runs
    with serving(follower, "vla-eval") as name:
        metrics = evaluated(url(name), corpus, episodes_per_task=2)
    scenes = {probe.scene.digest: probe.scene for probe in probes(read)}
    apart, fresh = run.value("min_distance"), Follower(follower.course)
    with closing(
        ManiSkillEvaluator(
            Conditions(task=run.task, world={"min_distance": apart}, seed=run.seed, repeats=2), fresh, load_catalogue()
        )
    ) as evaluator:
        outcomes = evaluator.evaluate(list(scenes.values()))
    assert metrics == {
        digest: [
            {"success": rollout.success_once, "success_at_end": rollout.success_at_end, "progress": rollout.progress}
            for rollout in outcome.rollouts
        ]
        for digest, outcome in zip(scenes, outcomes, strict=True)
    }
    assert {episode["success"] for episodes in metrics.values() for episode in episodes} == {True, False}
    assert follower.seeds == fresh.seeds == [run.seed, run.seed + 1] * len(scenes)
    assert "Spec validation passed" in log.text  # what our server declares is what the options say


def test_a_suite_alone(corpus: Path, follower: Follower):
    with serving(follower, "vla-eval") as name:
        metrics = evaluated(url(name), corpus, tasks=["failing"])
    assert list(metrics) == [case.scene.digest for case in read_corpus(corpus).cases]


def test_conventions_that_the_server_does_not_share_are_told(corpus: Path, follower: Follower, log):
    with serving(follower, "vla-eval") as name:
        evaluated(url(name), corpus, tasks=["failing"], max_tasks=1, params={"gripper": "close_positive"})
    assert "Spec mismatch: action [gripper]: gripper: binary_close_negative" in log.text


@pytest.mark.parametrize(
    ("params", "says"),
    [
        ({"camra": 128}, "unknown option 'camra'"),
        ({"camera": 3}, "camera: expected pixels as 224 or 320x240, or 0 for none, got '3'"),
        ({"timeout": 3}, "params: timeout: has no effect here"),
    ],
)
def test_options_that_there_are_not(corpus: Path, params: dict[str, object], says: str):
    with pytest.raises(UsageError, match=says):
        CorpusBenchmark(str(corpus), **params)


def test_what_is_no_action_is_an_error_and_the_next_episode_is_fine(corpus: Path):
    benchmark = CorpusBenchmark(str(corpus), camera=0)
    task = benchmark.get_tasks()[0]
    assert (task["suite"], task["instruction"]) == ("failing", "pick up pepsi can")
    for action in ({}, {"actions": ["a"]}, {"actions": [[0.0] * 6]}, {"actions": [float("nan")] * 7}):
        benchmark.reset(dict(task))
        with pytest.raises(PolicyError):
            benchmark.step(action)
    benchmark.reset(dict(task))
    assert not benchmark.step({"actions": np.zeros(7)}).done
    assert benchmark.get_metadata() == {"max_steps": 80}
    benchmark.cleanup()


CONFIG = """
server: {{url: "{url}"}}
output_dir: "{folder}"
benchmarks:
  - benchmark: "{benchmark}"
    params: {{corpus: "{corpus}", camera: 128, relative_to: current}}
"""


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("corpus", ["mini-pick-up", "mini-put-on", "mini-put-in", "mini-move-near"])
def test_vla_eval_run_of_a_shipped_corpus_agrees_with_regress_scene_by_scene(
    corpus: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    with closing(make_policy("mini")) as mini, serving(mini, "vla-eval") as name:
        config = CONFIG.format(url=url(name), folder=tmp_path, benchmark=NAME, corpus=corpus)
        (tmp_path / "corpus.yaml").write_text(config)
        command = [sys.executable, "-m", "vla_eval.cli.main", "run", "--config", str(tmp_path / "corpus.yaml")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (written,) = tmp_path.rglob("*.json")
    there = {
        task["task"]: [episode["metrics"]["success"] for episode in task["episodes"]]
        for task in json.loads(written.read_text())["tasks"]
    }
    assert main(["regress", str(corpus_dir() / corpus), "--policy", "mini", "--json"]) == 0
    here = json.loads(capsys.readouterr().out)["scenes"]
    assert there == {row["scene"]: [row["policy passed"] == "1 of 1"] for row in here}
