"""Environments of gymnasium as worlds: their spaces, rollouts, policies, files of parameters, and causes."""

import importlib.util
import json
import pickle
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from gymnasium import spaces

from tests.cli.typed import told, typed
from tests.documentation import files
from tests.worlds.carts import Cart, Carts, Expert, world
from vlafuzz.common.plugins import trust
from vlafuzz.errors import CatalogueError, PolicyError, UsageError
from vlafuzz.model import Conditions, Outcome, Scene, Verdict
from vlafuzz.model.scene import amount
from vlafuzz.policies.base import Observation
from vlafuzz.worlds import world_named
from vlafuzz.worlds.gym import GymWorld, Parameter, fitted, read_parameters
from vlafuzz.worlds.recording import Recording

CARTS = "python:tests.worlds.carts"
EXAMPLES = Path(__file__).parents[2] / "docs" / "worlds"
PAGE = EXAMPLES.with_suffix(".md")


def space(of: GymWorld, *vary: str):
    return of.space(of.tasks[0], "own", vary=vary)


def outcome(of: GymWorld, act, scene=None, recording=None, **options) -> Outcome:
    """The outcome of a policy, by default in the nominal scene."""
    all_scenes = space(of)
    conditions = Conditions(task=of.tasks[0], policy="own", **all_scenes.conditions)
    policy = type(of).policy(act, **options)()
    evaluator = of.evaluator(conditions, policy, all_scenes, recording=recording, checked=True)
    (found,) = evaluator.evaluate([scene or all_scenes.nominal()])
    evaluator.close()
    return found


def towards(observation):
    x, v, mark = observation
    return np.clip([3 * (mark - x) - 2 * v], -1, 1)


def test_a_function_of_an_observation_is_a_policy_and_info_says_success():
    assert outcome(Carts(), towards).verdict is Verdict.PASSED
    assert outcome(Carts(), lambda seen: [0.0]).verdict is Verdict.FAILED


def test_a_class_with_act_is_a_policy_and_hears_the_seed_of_each_rollout():
    class Noted:
        seeds: list[int] = []  # noqa: RUF012

        def reset(self, seed):
            self.seeds.append(seed)

        def act(self, observation):
            return towards(observation)

    assert outcome(Carts(), Noted).verdict is Verdict.PASSED
    assert Noted.seeds == [0]


@pytest.mark.parametrize(
    ("space", "action", "words"),
    [
        (spaces.Box(-1, 1, (2,)), [0.5, 1.5], r"the action \[0.5 1.5\] does not fit Box\(-1.0, 1.0, \(2,\)"),
        (spaces.Box(-1, 1, (2,)), [0.5], "does not fit Box"),
        (spaces.Discrete(3), [3.0], r"does not fit Discrete\(3\)"),
        (spaces.Discrete(3), [0.5], r"does not fit Discrete\(3\)"),
        (spaces.MultiDiscrete([2, 4]), [1.0, 4.0], "does not fit MultiDiscrete"),
    ],
)
def test_an_action_that_does_not_fit_is_named_in_a_sentence(space, action, words):
    with pytest.raises(PolicyError, match=words):
        fitted(space, np.array(action))


def test_an_action_that_does_not_fit_is_an_error_of_the_policy_and_no_failure():
    found = outcome(Carts(), lambda seen: [2.0])
    assert (found.verdict, "policy: bad_action" in found.detail) == (Verdict.ERROR, True)


def test_an_action_that_is_no_number_is_named_as_that():
    said = [outcome(Carts(), lambda seen, kind=kind: np.full(1, np.nan, kind)).detail for kind in ("f4", "f8")]
    assert all("is not finite" in detail for detail in said)


@pytest.mark.parametrize("act", [lambda seen: [0.5], lambda seen: np.full(1, 0.5, np.float32)])
def test_a_policy_does_the_same_with_and_without_a_recording_of_what_it_observes(act):
    plain, watched = (outcome(Carts(), act, recording=recording) for recording in (None, Recording(0)))
    (mine,), (theirs,) = plain.rollouts, watched.rollouts
    assert (mine.states_hash, mine.actions.tolist()) == (theirs.states_hash, theirs.actions.tolist())


def test_actions_are_kept_as_they_were_where_a_policy_uses_its_array_again():
    kept = np.zeros(1, np.float32)
    (rollout,) = outcome(Carts(), lambda seen: np.add(kept, np.float32(0.01), out=kept)).rollouts
    assert rollout.actions[:3, 0] == pytest.approx([0.01, 0.02, 0.03])


def test_a_space_goes_through_a_pipe_even_where_stages_are_functions_without_a_name():
    trust(f"{CARTS}:Staged")
    known = world_named(f"{CARTS}:Staged").space(f"{CARTS}:Staged/reach", "own", vary=["mass"])
    again = pickle.loads(pickle.dumps(known))
    assert (again.conditions, again.nominal()) == (known.conditions, known.nominal())


def test_actions_of_seven_numbers_arrive_as_they_are():
    class Seven(Cart):
        action_space = spaces.Box(-1, 1, (7,), np.float32)

        def step(self, action):
            assert action == pytest.approx([0.5] * 7)
            return super().step(action)

    assert outcome(world(Seven)(), lambda seen: np.full(7, 0.5)).verdict is not Verdict.ERROR


def test_each_number_of_an_action_has_its_own_bounds():
    class Two(Cart):
        action_space = spaces.Box(np.array([-1, 0], np.float32), np.array([1, 5], np.float32))

        def step(self, action):
            return super().step(action[:1])

    allowed, beyond = (outcome(world(Two)(), lambda _, act=act: np.array(act, "f4")) for act in ([-0.5, 4], [2, 4]))
    assert allowed.verdict is not Verdict.ERROR
    assert "the action [2. 4.] does not fit" in beyond.detail


def test_a_rollout_ends_where_the_environment_does():
    class Falls(Cart):
        def step(self, action):
            observation, reward, _, truncated, info = super().step(action)
            return observation, reward, self.x > 0.2, truncated, info

    (rollout,) = outcome(world(Falls)(), towards).rollouts
    assert len(rollout.actions) < 20


class Arm:
    """As MuJoCo's model has its bodies: by name, each with arrays."""

    def __init__(self):
        self.bodies = {"hand": np.array([2.0, 3.0, 0.0])}
        self.gravity = np.array([0.0, 0.0, -9.81])

    def body(self, name):
        return self.bodies[name]


def armed(*sets: str, unit: str = ""):
    """A world with one value more, which has no code."""

    class Armed(Carts):
        parameters = (*Carts.parameters, Parameter("value", 0.5, 2.0, nominal=1.0, step=0.1, unit=unit, sets=sets))

        class env(Cart):  # noqa: N801
            def __init__(self):
                self.arm, self.mass = Arm(), 2.0

    return Armed()


@pytest.mark.parametrize(
    ("sets", "unit", "arm"),
    [
        (["arm/body/hand"], "×", ([3.0, 4.5, 0.0], -9.81)),
        (["arm/body/hand"], "kg", ([1.5, 1.5, 1.5], -9.81)),
        (["arm/body/hand/1", "arm/gravity/2"], "×", ([2.0, 4.5, 0.0], -14.715)),
    ],
)
def test_a_value_sets_what_its_parameter_says_and_is_read_back(sets, unit, arm):
    world = armed(*sets, unit=unit)
    nominal = dict(space(world).nominal().values)
    for value in (0.5, 1.5):  # factors are of what there was at first
        now = world.reset(nominal | {"value": value}, 0)
    assert (now.env.arm.bodies["hand"].tolist(), now.env.arm.gravity[2]) == (arm[0], pytest.approx(arm[1]))
    assert world.applied(now) == {"value": pytest.approx(1.5)}


def test_a_value_that_says_what_it_sets_arrives_whatever_apply_and_start_do():
    class Own(type(armed("arm/gravity/2"))):
        def apply(self, env, values):
            env.wind = values["slope"]

        def start(self, env, values, seed):
            self.apply(env, values)
            return env.reset(seed=seed, options=values)

    env = Own().reset(Own().nominal_values | {"value": 1.5, "slope": 4}, 0).env
    assert (env.arm.gravity[2], env.wind) == (1.5, 4)


def test_the_rollout_by_hand_of_the_page_solves_the_scene(tmp_path, monkeypatch, capsys):
    for name, content in files(PAGE).items():
        (tmp_path / name).write_text(content)
    monkeypatch.syspath_prepend(tmp_path)
    (by_hand,) = re.findall(r"```python\n(from cartpole .*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    exec(by_hand, {})
    assert capsys.readouterr().out.startswith("150 True {'length': 0.5")


def test_a_value_that_sets_nothing_there_is_named_in_a_sentence():
    with pytest.raises(UsageError, match=r"sets: arm/body/foot: the environment has none: 'foot'"):
        armed("arm/body/foot").reset({}, 0)


def test_observations_may_be_nested_and_pictures_in_them_are_no_numbers():
    class Nested(Cart):
        def seen(self):
            return {"hand": super().seen(), "camera": np.zeros((4, 4, 3), np.uint8), "more": (np.ones(2),)}

    nested = world(Nested)()
    assert nested.observe(nested.reset(dict(space(nested).nominal().values), 0)).shape == (5,)


def test_an_environment_that_was_made_without_pictures_is_not_asked_for_one():
    class Blind(Cart):
        render_mode = None

        def render(self):
            raise RuntimeError("render_mode is not set")

    for kind, shape in ((Blind, None), (Cart, (24, 48, 3))):
        made = world(kind)()
        picture = made.picture(made.reset(dict(space(made).nominal().values), 0))
        assert (None if picture is None else picture.shape) == shape


def test_a_space_of_actions_that_is_no_array_is_refused():
    class Odd(Cart):
        action_space = spaces.Dict({"push": spaces.Discrete(2)})

    with pytest.raises(UsageError, match="actions of Dict are not supported"):
        _ = world(Odd)().action_width


FILE = """
length: {range: [0.25, 1.5], nominal: 0.5, unit: m, says: how long it is}
boxes: {kind: integer, range: [0, 4], nominal: 1}
floor: {options: [wood, ice]}
heading: {kind: angle, nominal: 0, unit: °}
x: {range: [-1, 1], nominal: 0, group: place}
y: {range: [-1, 1], nominal: 0, group: place}
"""


@pytest.fixture
def read(tmp_path):
    def read(text: str):
        (tmp_path / "p.yaml").write_text(text)
        return read_parameters(tmp_path / "p.yaml")

    return read


def test_a_file_says_kinds_units_groups_and_what_a_value_sets(read):
    length, boxes, floor, heading, *_ = read(FILE)
    assert (length.step, length.says) == (0.02, "how long it is")
    assert (boxes.step, boxes.told(2.0), isinstance(boxes.told(2.0), int)) == (1, 2, True)
    assert (floor.options, heading.gene.kind, heading.gene.grid.wraps) == (("wood", "ice"), "angle", True)
    assert (amount("values.length", 0.5), amount("values.heading", 30)) == ("0.5 m", "30°")
    one, two = read("one: {range: [0, 1], nominal: 0, sets: g}\ntwo: {range: [0, 1], nominal: 0, sets: [m, l]}")
    assert (one.sets, two.sets) == (("g",), ("m", "l"))


@pytest.fixture
def filed(read) -> Carts:
    """A world with the parameters of the file."""
    return type("Filed", (Carts,), {"parameters": read(FILE)})()


def test_parameters_of_a_group_vary_and_are_reset_together(filed):
    drawn = space(filed, "place").sample(np.random.default_rng(3))
    changed = {name for name, value in drawn.values if value != dict(space(filed).nominal().values)[name]}
    assert changed == {"x", "y"}
    assert space(filed).reset(drawn, ["place"]) == space(filed).nominal()


def test_whole_numbers_are_whole_again_in_a_stored_scene_and_stay_whole_near_one(filed):
    stored = Scene.from_json(space(filed).nominal().to_json())
    assert repr(filed.values_in(stored)["boxes"]) == "1"
    assert filed.values_in(stored) == dict(stored.values)
    near = dict(space(filed).jittered(space(filed).nominal(), 1).values)
    assert near["boxes"] == 1
    assert 0 < abs(near["length"] - 0.5) < 0.01


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("length: {range: [1, 2], nominal: 3}", "nominal 3 is not within 1 to 2"),
        ("length: {range: [1, 2]}", "no range or no nominal value"),
        ("length: {rang: [1, 2], nominal: 1}", "length.rang"),
        ("Length: {range: [1, 2], nominal: 1}", "'Length'"),
        ("floor: {options: [wood]}", "two or more options"),
        ("turn: {kind: angle, range: [-90, 90], nominal: 0}", "an angle goes from -180 to 180"),
        ("length: {range: [2, 2], nominal: 2}", "is no range"),
    ],
)
def test_what_is_wrong_in_a_file_is_named_with_the_key(read, text, words):
    with pytest.raises(CatalogueError, match=words):
        read(text)


def test_ranges_that_say_nothing_new_are_stored_as_they_always_were():
    stored = json.loads(space(Carts(), "mass").conditions["operators"])
    assert sorted(stored["operators"]["floor"]) == ["high", "low", "name", "nominal", "options", "says", "step"]
    assert '"sets": ["arm/gravity/2"]' in space(armed("arm/gravity/2")).operators.to_json()
    assert Parameter("mass", 0, 1).operator == "mass"


def test_a_run_names_what_the_policy_cannot_do_and_the_expert_can(tmp_path, capsys):
    store = tmp_path / "carts.db"
    typed(capsys, f"run --world {CARTS}:Expert --policy {CARTS}:sliding --budget 80 --store {store}")
    row, *_ = told(capsys, f"report {store} --trust --json")
    assert (row["operators"], row["witness"]) == (["mark"], "expert")
    typed(capsys, f"report {store} --trust --out {tmp_path}/r.html")
    assert "data:video/mp4" in (tmp_path / "r.html").read_text()


def example(name: str):
    """A module of the pages, as a user has it."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("package", "name", "kind", "tasks"),
    [
        ("gymnasium", "pendulum", "Pendulum", ["swing-up"]),
        ("mani_skill", "maniskill", "ManiSkill", ["pick-cube", "stack-cube", "place-sphere", "push-cube", "pull-cube"]),
        ("gymnasium_robotics", "fetch", "Fetch", ["push"]),
        ("metaworld", "meta_world", "MetaWorld", ["reach-v3", "push-v3", "pick-place-v3", "soccer-v3", "push-wall-v3"]),
    ],
)
def test_the_expert_of_an_example_solves_its_nominal_scenes(package, name, kind, tasks):
    pytest.importorskip(package)
    module = example(name)
    for task in tasks:
        opened = getattr(module, kind)().opened(task)
        now = opened.reset(dict(space(opened).nominal().values), 0)
        solved = 0
        while not opened.ended(now) and now.steps < opened.horizon and solved < opened.stages[-1].steps:
            now = opened.step(now, np.asarray(opened.solve(now), dtype=np.float64))
            solved = solved + 1 if opened.stages[-1].holds(now) else 0
        opened.close()
        assert solved == opened.stages[-1].steps, task


@pytest.mark.render
def test_size_light_and_camera_of_maniskill_are_seen():
    pytest.importorskip("mani_skill")
    world = example("maniskill").Drawn().opened("stack-cube")
    nominal = dict(space(world).nominal().values)
    usual, again = (world.picture(world.reset(nominal, 0)) for _ in range(2))
    assert np.array_equal(usual, again)
    for name in ("size", "light", "camera-left", "camera-up", "camera-pitch", "camera-yaw"):
        shown = world.picture(world.reset(nominal | {name: world.named[name].high}, 0))
        assert (shown != usual).any(), name
    world.close()


@pytest.mark.filterwarnings("ignore")
def test_act_learns_what_the_expert_does_and_acts_by_what_was_saved(tmp_path, monkeypatch):
    pytest.importorskip("lerobot")
    monkeypatch.setenv("ACT_FOLDER", str(tmp_path / "policy"))
    act, of = example("act"), Expert()
    shown = [*act.demonstrations(of, "reach", 4, ["mark"])]
    act.train(shown, act.FOLDER, 60)
    policy, (seen, chunks, padding) = act.Act(), shown[0]
    assert [padding[0].sum(), padding[-1].sum()] == [0, act.CHUNK - 1]
    answers = policy.act([Observation("it", step, "", state=state) for step, state in enumerate(seen)])
    wrong = np.abs([answer.actions for answer in answers] - chunks)[~padding]
    assert wrong.mean() < np.abs(chunks - chunks.mean())[~padding].mean() / 2
    everywhere = space(of)
    conditions = Conditions(task="reach", policy="own", **everywhere.conditions)
    evaluator = of.evaluator(conditions, policy, everywhere, recording=None, checked=True)
    assert evaluator.evaluate([everywhere.nominal()])[0].verdict in (Verdict.PASSED, Verdict.FAILED)
    evaluator.close()
