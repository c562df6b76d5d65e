import json
from pathlib import Path

import numpy as np

from tests.doubles import manifest, scene
from tests.triage.runners import PlantedRunner
from vlafuzz.compare.failures import CountedRun, Failure
from vlafuzz.compare.samples import Sampled, Witnesses, sample, solvable
from vlafuzz.store.records import Run

SCENES = [scene(x=number / 100) for number in range(6)]


def counted(seed: int, *xs: int) -> CountedRun:
    failures = tuple(
        Failure(scene=SCENES[x], cell="a", severity=1.0, quality=0.5, spent=1, vector=np.zeros(1)) for x in xs
    )
    return CountedRun(
        run=Run(id=seed, manifest=manifest(seed=seed), status="finished", started=""), failures=failures
    )


def runner(solvable: int = 3) -> PlantedRunner:
    return PlantedRunner([], solvable=lambda scene: scene.targets[0].x * 100 < solvable)


def test_a_sample_takes_from_every_run_and_no_scene_twice():
    runs = [counted(0, 0, 1, 2, 3), counted(1, 4), counted(2)]
    assert Sampled(SCENES[4], run=1) in sample(runs, 2)
    assert (
        sorted((failure.scene for failure in sample(runs, 50)), key=lambda scene: scene.targets[0].x)
        == SCENES[:5]
    )
    assert len(sample([counted(0, 0, 1), counted(1, 0, 1)], 50)) == 2
    assert sample(runs, 3) == sample(runs, 3)


def test_what_the_expert_solves_is_kept_and_not_tried_again(tmp_path: Path):
    witnesses = Witnesses(tmp_path / "w.jsonl", manifest())
    witnesses.find([*SCENES[2:4], SCENES[2]], runner(), lambda done, of: None)
    again = Witnesses(tmp_path / "w.jsonl", manifest())
    assert again.solved == {SCENES[2].digest: True, SCENES[3].digest: False}
    assert again.missing(SCENES[2:5]) == [SCENES[4]]


def test_under_other_conditions_it_is_tried_again(tmp_path: Path):
    Witnesses(tmp_path / "w.jsonl", manifest()).find(SCENES[:1], runner(), lambda done, of: None)
    assert Witnesses(tmp_path / "w.jsonl", manifest(criteria="published")).missing(SCENES[:1]) == SCENES[:1]


def test_a_line_that_was_cut_short_is_passed_over(tmp_path: Path):
    path = tmp_path / "w.jsonl"
    Witnesses(path, manifest()).find(SCENES[:2], runner(), lambda done, of: None)
    path.write_text(path.read_text()[:-20] + "\n" + json.dumps([1]) + "\n")
    assert Witnesses(path, manifest()).missing(SCENES[:2]) == SCENES[1:2]


def test_the_share_is_of_what_was_sampled():
    sampled = [Sampled(shown, run=1) for shown in SCENES[:4]]
    result = solvable(sampled, {shown.digest: shown != SCENES[0] for shown in SCENES})
    assert result is not None
    assert (result.solved, result.of) == (3, 4)
    assert solvable([], {}) is None
