"""What is written in the reference's format reads back as the same scene."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vlafuzz.model.scene import Camera, Light, Scene
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS
from vlafuzz.worlds.tabletop.vlatest.read import read_vlatest
from vlafuzz.worlds.tabletop.vlatest.write import write_vlatest

CATALOGUE = load_catalogue()
IN_FORMAT = ("target-type", "target-position", "target-orientation", "confounder-type", "confounder-position",
        "confounder-orientation", "confounder-count")  # fmt: skip


def scenes(task: str, number: int) -> list[Scene]:
    space = SearchSpace(load_operators().only(IN_FORMAT), CATALOGUE, task)
    return [space.sample(np.random.default_rng(seed)) for seed in range(number)]


def near(first: Scene, other: Scene) -> bool:
    def flat(scene: Scene) -> list[float]:
        return [value for thing in scene.placements for value in (thing.x, thing.y, thing.yaw % 360)]

    def names(scene: Scene) -> list[tuple[str, str]]:
        return [(thing.object, thing.rest) for thing in scene.placements]

    if (first.task, first.instruction, names(first)) != (other.task, other.instruction, names(other)):
        return False
    off = np.abs(np.subtract(flat(first), flat(other)))
    return bool(np.all(np.minimum(off, 360 - off) < 1e-3))


@pytest.mark.parametrize("task", TASKS)
def test_scenes_read_back_as_they_were(tmp_path: Path, task: str) -> None:
    wanted = scenes(task, 40)
    path = tmp_path / f"{task}.json"
    left_out = write_vlatest(path, wanted, CATALOGUE)
    assert all("rest" in reason or "VLATest has no" in reason for reason in left_out)
    read = read_vlatest(path, CATALOGUE).scenes
    assert len(read) == len(wanted) - sum(left_out.values()) > 20
    assert all(any(near(scene, candidate) for candidate in wanted) for scene in read)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"light": Light(2.0)}, "light"),
        ({"camera": Camera(yaw=1.0)}, "camera"),
        ({"instruction": "Fetch it"}, "wording"),
        ({"then": ("hold it up",)}, "wording"),
    ],
)
def test_what_the_format_cannot_express_is_left_out_and_counted(tmp_path: Path, change, reason: str) -> None:
    scene = scenes("pick-up", 1)[0]
    path = tmp_path / "t-grasp.json"
    left_out = write_vlatest(path, [replace(scene, **change), scene], CATALOGUE)
    assert left_out == {f"VLATest's scene files have no {reason}": 1}
    assert len(read_vlatest(path, CATALOGUE).scenes) == 1


def test_tasks_and_objects_that_vlatest_does_not_have_are_left_out_and_counted(tmp_path: Path) -> None:
    scene = scenes("pick-up", 1)[0]
    unknown = replace(scene, targets=(replace(scene.targets[0], object="anvil"),))
    others = [replace(scene, task="juggle"), replace(scene, targets=scene.targets * 2), unknown]
    assert write_vlatest(tmp_path / "t-grasp.json", [*others, scene], CATALOGUE) == {
        "VLATest has no task juggle": 1,
        "VLATest has no pick-up with 2 target(s)": 1,
        "VLATest has no anvil": 1,
    }
