"""The extra operators: off by default, and like the others when they vary."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from vlafuzz.errors import CatalogueError, SceneError, UsageError
from vlafuzz.model import Backdrop, Conditions, InitialPose, Latency, Noise, Scene
from vlafuzz.model.scene import EXTRAS as PARTS, Exposure
from vlafuzz.worlds import world_of
from vlafuzz.worlds.manipulation.extras import EVENTS, EXTRAS
from vlafuzz.worlds.manipulation.operator_set import stored_operators
from vlafuzz.worlds.manipulation.operators import OPERATORS
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS

quickly = settings(max_examples=3, derandomize=True, deadline=None, database=None)
tasks = pytest.mark.parametrize("task", TASKS)
# Of states that worlds other than the tabletop have.
ELSEWHERE = {"initial-state", "bystander-position", "bystander-orientation", "target-knock", "target-switch"}
extras = pytest.mark.parametrize("name", sorted(EXTRAS - ELSEWHERE - {"goal-slide", "newcomer"}))
seeds = st.integers(0, 2**32 - 1)


@cache
def space(task: str = "pick-up", *vary: str) -> SearchSpace:
    return SearchSpace(load_operators().only(vary or OPERATORS), load_catalogue(), task)


@tasks
@quickly
@given(seed=seeds)
def test_with_all_operators_on_every_decoded_scene_comes_back(task: str, seed: int) -> None:
    scene = space(task).decode(np.random.default_rng(seed).random(space(task).dim))
    again = space(task).decode(space(task).encode(scene))
    assert again == scene
    assert Scene.from_json(scene.to_json()) == scene
    assert Scene.from_json(scene.to_json()).digest == scene.digest


@tasks
@quickly
@given(seed=seeds)
def test_random_scenes_vary_every_extra_that_is_on(task: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    drawn = [space(task).sample(rng) for _ in range(8)]
    assert all(len(scene.events) == 2 for scene in drawn)
    for part in PARTS.keys() - {OPERATORS[name].part for name in ELSEWHERE.union(EVENTS)}:
        assert any(getattr(scene, part) != PARTS[part] for scene in drawn)
    assert [space(task).decode(space(task).encode(scene)) for scene in drawn] == drawn


def far(one: SearchSpace, part: str) -> Scene:
    """The scene at an end of all ranges, at which a part is not nominal."""
    ends = (one.decode(np.full(one.dim, end)) for end in (1.0, 0.0))
    return next(scene for scene in ends if getattr(scene, part) != PARTS[part])


@extras
def test_an_extra_alone_varies_its_part_of_the_scene_and_can_be_reset(name: str) -> None:
    one = space("pick-up", name)
    part = OPERATORS[name].part
    farthest = far(one, part)
    assert replace(farthest, **{part: PARTS[part]}) == one.nominal()
    assert one.reset(farthest, [name]) == one.nominal()
    assert one.severities(farthest)[name] > 0.5


@extras
def test_a_scene_of_an_extra_that_does_not_vary_has_no_genome_but_a_severity(name: str) -> None:
    off, on = space("pick-up", "light"), space("pick-up", name)
    assert name not in off.severities(off.sample(np.random.default_rng(0)))
    scene = far(on, OPERATORS[name].part)
    with pytest.raises(SceneError, match=f"{name} does not vary"):
        off.encode(scene)
    assert off.severities(scene)[name] == on.severities(scene)[name]


@extras
def test_sets_that_vary_an_extra_have_digests_of_their_own_and_are_read_back_as_stored(name: str) -> None:
    usual = load_operators()
    assert usual.only({*usual.varied, name}).digest != usual.digest
    assert name not in json.loads(usual.conditions["operators"])["operators"]
    for operators in (usual, usual.only([name])):
        conditions = Conditions(task="pick-up", operators=operators.conditions["operators"])
        stored = stored_operators(Path("here.db"), conditions)
        assert stored.digest == operators.digest
        assert stored.operators == operators.operators


def test_bounds_of_visibility_are_read_back_and_missing_in_older_stores() -> None:
    operators = load_operators()
    text, bounds = operators.conditions["operators"], operators.conditions["world"]["visible"]
    kept = Conditions(task="pick-up", operators=text, world={"visible": bounds})
    assert stored_operators(Path("here.db"), kept).visible == operators.visible
    assert stored_operators(Path("here.db"), kept.without("visible")).visible is None
    assert load_operators("paper").conditions["world"]["visible"] == ""


@pytest.mark.parametrize(("robot", "joints"), [("panda", 7), ("widowx", 6), ("google", 7)])
def test_a_robot_has_a_gene_for_each_joint_of_its_arm(robot: str, joints: int) -> None:
    operators = load_operators(robot if robot != "panda" else None).only(["initial-pose"])
    one = SearchSpace(operators, load_catalogue(), "pick-up", robot)
    assert [gene.path for gene in one.genes] == [f"initial_pose.j{joint + 1}" for joint in range(joints)]


def test_a_file_without_extras_gets_the_shipped_ranges_and_varies_none(tmp_path: Path) -> None:
    operators = load_operators()
    kept = {name: operator for name, operator in operators.operators.items() if name not in EXTRAS}
    plain = {name: operator.model_dump(mode="json", exclude_none=True) for name, operator in kept.items()}
    path = tmp_path / "mine.yaml"
    path.write_text(json.dumps({"min_distance": 0.15, "operators": plain}))
    mine = load_operators(path)
    assert (mine.operators, mine.visible) == (operators.operators, operators.visible)
    assert not mine.varied & EXTRAS


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("control-latency: {delay: {low: 1, high: 3, step: 1}}", "delay does not include 0"),
        ("control-latency: {delay: {low: 0, high: 3, step: 0.5}}", "delay is a whole number"),
    ],
)
def test_a_wrong_range_of_an_extra_is_an_error(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(f"extends: tabletop\noperators: {{{text}}}")
    with pytest.raises(CatalogueError, match=says):
        load_operators(path)


@pytest.mark.parametrize(
    ("part", "says"),
    [
        ({"latency": {"delay": -1}}, "latency.delay: input should be greater than or equal to 0"),
        ({"backdrop": {"table": "tartan"}}, "backdrop.table: "),
        ({"initial_pose": {"j8": 1}}, "initial_pose.j8: "),
        ({"noise": {"jpeg": 101}}, "noise.jpeg: "),
        ({"latency": {"dealy": 1}}, "latency.dealy: "),
    ],
)
def test_a_wrong_value_of_an_extra_is_refused_with_its_key(part: dict[str, object], says: str) -> None:
    text = json.dumps(json.loads(space().nominal().to_json()) | part)
    with pytest.raises(SceneError) as caught:
        Scene.from_json(text)
    assert caught.value.message.startswith(says)


@pytest.mark.parametrize(
    ("scene", "digest"),
    [
        (replace(space().nominal(), backdrop=Backdrop(colour="blue")), "1bbd1b3818a295e5e01d5c4b6f248dce"),
        (replace(space().nominal(), initial_pose=InitialPose(j2=1.5)), "c956229646bea75a49d280a6a2141503"),
        (replace(space().nominal(), noise=Noise(blur=1.5, jpeg=40)), "a75e681a2a2321f97c4596d330d1f7b5"),
        (replace(space().nominal(), latency=Latency(2)), "42d1766cd9fa71426097fb06c5d88623"),
        (replace(space().nominal(), exposure=Exposure(0.5)), "4b837c362c7b43c3059edd0cf5ce0cf1"),
    ],
    ids=["backdrop", "initial-pose", "noise", "latency", "exposure"],
)
def test_digests_of_scenes_with_extras_are_constants_of_the_file_format(scene: Scene, digest: str) -> None:
    assert scene.digest == digest


def test_a_newcomer_is_a_confounder_so_there_is_none_without_them() -> None:
    with pytest.raises(UsageError, match="newcomer: there is no confounder to vary"):
        load_operators().only(["newcomer"])
    one = space("pick-up", "newcomer", "confounder-count")
    drawn = [one.sample(np.random.default_rng(seed)) for seed in range(20)]
    assert {bool(scene.events) for scene in drawn if scene.confounders} == {True, False}
    assert not any(scene.events for scene in drawn if not scene.confounders)


@tasks
def test_all_events_are_named_by_one_word_and_a_task_without_a_second_target_lacks_one(task: str) -> None:
    varied = {gene.operator for gene in world_of(task).space(task, "panda", vary=["events"]).genes}
    assert set(EVENTS) - varied == ({"goal-slide"} if task == "pick-up" else set())
