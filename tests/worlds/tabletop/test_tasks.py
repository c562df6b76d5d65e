"""The four tasks, judged on states made by hand without a simulator, and their wordings."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.tasks import ARM, HAND, TABLE, TASKS, State, StateMonitor, load_wordings

PICK_UP, MOVE_NEAR, PUT_ON, PUT_IN = TASKS.values()
CATALOGUE = load_catalogue()
CAN, CUBE, PLATE, BASKET, SPONGE = (CATALOGUE[n] for n in ("coke_can", "green_cube", "plate", "basket", "sponge"))
REST = {model.name: model.stable_poses[0].height for model in (CAN, CUBE, PLATE, BASKET, SPONGE)}
HELD = {(0, HAND)}

STEP = 0.2  # seconds


def state(*positions, held=None, touching=None, speed=0.0, spin=0.0, turned=None, tcp=(0.0, 0.0, 0.17)) -> State:
    """Objects upright at some positions; everything on the table and at rest unless said otherwise."""
    rotations = np.stack([np.eye(3)] * len(positions))
    for index, rotation in (turned or {}).items():
        rotations[index] = rotation.as_matrix()
    now = np.array(positions, dtype=np.float64)
    turn = Rotation.from_euler("y", spin * STEP).as_matrix()
    earlier = now - [speed * STEP, 0, 0], rotations @ turn
    contacts = frozenset({(i, TABLE) for i in range(len(positions))} if touching is None else touching)
    hand = {"tcp": np.array(tcp), "tcp_rotation": np.eye(3), "opening": 0.04, "held": held}
    return State(positions=now, rotations=rotations, earlier=earlier, seconds=STEP, contacts=contacts, **hand)


def watch(monitor: StateMonitor, *states: State) -> StateMonitor:
    for state in states:
        monitor.observe(state)
    return monitor


class TestPickUp:
    """A can at (0.1, 0), the hand above the middle of the table."""

    ground = (0.1, 0.0, REST["coke_can"])

    def monitor(self) -> StateMonitor:
        return StateMonitor(PICK_UP, (CAN,), state(self.ground))

    def up(self, height: float, held: int | None = 0, touching=HELD) -> State:
        place = (0.1, 0.0, REST["coke_can"] + height)
        return state(place, held=held, touching=touching, tcp=place)

    def test_five_steps_held_up_are_success_and_four_are_not(self):
        monitor = watch(self.monitor(), *[self.up(0.03)] * 4)
        assert not monitor.success_once
        assert watch(monitor, self.up(0.03)).success_once
        assert monitor.reached == ["grasp", "lift", "success"]

    @pytest.mark.parametrize(
        ("height", "held", "stages"),
        [(0.0, 0, ["grasp"]), (0.019, 0, ["grasp"]), (0.021, None, []), (0.021, 1, []), (0.5, None, [])],
    )
    def test_lift_needs_two_centimetres_and_a_grasp_of_the_target(self, height, held, stages):
        assert watch(self.monitor(), *[self.up(height, held)] * 8).reached == stages

    def test_a_stage_needs_two_steps_in_a_row(self):
        monitor = watch(self.monitor(), self.up(0, 0), self.up(0, None), self.up(0, 0))
        assert monitor.reached == []
        assert watch(monitor, self.up(0, 0)).reached == ["grasp"]

    def test_success_at_the_end_is_lost_with_the_object_and_success_once_is_not(self):
        monitor = watch(self.monitor(), *[self.up(0.03)] * 5)
        assert monitor.success_now
        watch(monitor, self.up(0.0, None))
        assert (monitor.success_now, monitor.success_once) == (False, True)

    def test_progress_grows_with_approach_grasp_lift_and_hold(self):
        way = [state(self.ground, tcp=(0.1 * part, 0.0, 0.17 - 0.1 * part)) for part in (0.2, 0.5, 0.9)]
        way += [self.up(height) for height in (0.0, 0.0, 0.01, 0.015, 0.02, 0.02, 0.02, 0.02, 0.02)]
        trace = watch(self.monitor(), *way).trace
        assert np.all(np.diff(trace) >= 0)
        assert trace[2] < 1 / 3 <= trace[4] < 2 / 3 <= trace[8] < 1.0 == trace[-1]

    def test_going_away_never_counts_as_progress_and_the_best_moment_stays(self):
        near, far = state(self.ground, tcp=(0.1, 0.0, 0.08)), state(self.ground, tcp=(-0.5, 0.3, 0.6))
        monitor = watch(self.monitor(), far)
        assert monitor.progress == 0.0
        best = watch(monitor, near).progress
        assert watch(monitor, far).progress == best > 0.2


class TestMoveNear:
    """Two cubes of 3 cm, 20 cm apart along y, and a third one aside."""

    b, c = (0.0, 0.2, 0.015), (0.1, -0.2, 0.015)

    def monitor(self) -> StateMonitor:
        return StateMonitor(MOVE_NEAR, (CUBE, CUBE, CUBE), state((0.0, 0.0, 0.015), self.b, self.c))

    def at(self, y: float, z: float = 0.015, **more) -> State:
        return state((0.0, y, z), self.b, self.c, **more)

    @pytest.mark.parametrize(("gap", "near"), [(0.049, True), (0.051, False), (0.001, True)])
    def test_success_is_a_gap_of_five_centimetres_between_footprints(self, gap, near):
        assert watch(self.monitor(), *[self.at(0.2 - 0.03 - gap)] * 2).success_once is near

    def test_a_turned_footprint_reaches_farther(self):
        moments = [self.at(0.2 - 0.03 - 0.055, turned={0: Rotation.from_euler("z", 45, degrees=True)})] * 2
        assert watch(self.monitor(), *moments).success_once

    @pytest.mark.parametrize(
        "more", [{"z": 0.03}, {"speed": 0.02}, {"spin": 0.2}], ids=["in the air", "moving", "rolling"]
    )
    def test_it_must_lie_at_rest_on_the_table(self, more):
        assert not watch(self.monitor(), *[self.at(0.14, **more)] * 5).success_once

    @pytest.mark.parametrize(("which", "axis", "counts"), [(1, "x", False), (1, "z", True), (0, "x", True)])
    def test_only_b_must_not_be_knocked_over(self, which, axis, counts):
        turned = {which: Rotation.from_euler(axis, 90, degrees=True)}
        monitor = watch(self.monitor(), *[self.at(0.14, turned=turned)] * 2)
        assert monitor.reached == (["grasp", "move", "success"] if counts else [])

    @pytest.mark.parametrize(("y", "other", "moved"), [(0.031, 0.0, True), (0.029, 0.0, False), (0.05, 0.06, False)])
    def test_the_move_is_three_centimetres_and_more_than_anything_else_moved(self, y, other, moved):
        c = (0.1, -0.2 - other, 0.015)
        states = [state((0.0, 0.0, 0.015), self.b, self.c, held=0)] * 2
        states += [state((0.0, y, 0.015), self.b, c, held=0)] * 2
        assert ("move" in watch(self.monitor(), *states).reached) is moved

    def test_progress_grows_as_the_gap_closes(self):
        way = [self.at(y, held=0) for y in (0.0, 0.0, 0.01, 0.02, 0.04, 0.04, 0.06, 0.09, 0.11)]
        trace = watch(self.monitor(), *way, *[self.at(0.14)] * 2).trace
        assert np.all(np.diff(trace) >= 0)
        assert 2 / 3 < trace[-3] < trace[-1] == 1.0


@pytest.mark.parametrize(
    ("chosen", "models"),
    [(PICK_UP, (CAN,)), (MOVE_NEAR, (CUBE, SPONGE)), (PUT_ON, (CUBE, PLATE)), (PUT_IN, (CUBE, BASKET))],
    ids=TASKS,
)
def test_progress_is_in_zero_to_one_and_never_one_without_success_whatever_happens(chosen, models):
    rng = np.random.default_rng(0)
    spots = [(0.2 * index, 0.0, REST[model.name]) for index, model in enumerate(models)]
    everything = [0, 1, TABLE, HAND, ARM]
    for _ in range(20):
        monitor = StateMonitor(chosen, models, state(*spots))
        for _ in range(12):
            moved = np.array(spots) + rng.normal(0, 0.1, (len(spots), 3)) * [1, 1, 0.3]
            touching = {(0, everything[index]) for index in rng.choice([1, 2, 3], rng.integers(0, 3))}
            watch(monitor, state(*moved, held=rng.choice([None, 0, 0]), touching=touching, tcp=rng.normal(0, 0.3, 3)))
        assert monitor.trace.min() >= 0
        assert (monitor.trace.max() == 1.0) == monitor.success_once
        assert monitor.progress == monitor.trace.max() <= 1.0
        assert monitor.reached == list(chosen.stage_names[: len(monitor.reached)])


def test_at_rest_is_slower_than_a_centimetre_and_a_tenth_of_a_radian_a_second():
    motions = ((0.009, 0.09), (0.011, 0), (0, 0.11))
    at_rest = [state((0, 0, 0), speed=speed, spin=spin).at_rest(0) for speed, spin in motions]
    assert at_rest == [True, False, False]


class TestPutOn:
    """A cube and a plate 20 cm away."""

    plate, on = (0.0, 0.2, REST["plate"]), {(0, 1), (1, 0), (1, TABLE)}
    top = REST["plate"] * 2 + 0.015

    def monitor(self) -> StateMonitor:
        return StateMonitor(PUT_ON, (CUBE, PLATE), state((0.0, 0.0, 0.015), self.plate))

    def at(self, y: float, z: float, **more) -> State:
        return state((0.0, y, z), self.plate, **more)

    def test_resting_on_b_is_success(self):
        monitor = watch(self.monitor(), *[self.at(0.2, self.top, touching=self.on)] * 2)
        assert (monitor.success_once, monitor.reached) == (True, ["grasp", "move", "success"])

    @pytest.mark.parametrize(
        "more",
        [
            {"touching": {(0, 1), (0, TABLE)}},
            {"touching": {(0, 1), (0, HAND)}},
            {"touching": {(0, 1), (0, ARM)}},
            {"touching": set()},
            {"touching": {(0, 1)}, "speed": 0.02},
            {"touching": {(0, 1)}, "spin": 0.2},
        ],
        ids=["on the table too", "in the hand", "at the arm", "above it", "sliding", "rolling"],
    )
    def test_what_touches_something_else_or_moves_does_not_count(self, more):
        assert not watch(self.monitor(), *[self.at(0.2, self.top, **more)] * 5).success_once

    @pytest.mark.parametrize(
        ("y", "z", "over"), [(0.2, 0.1, True), (0.13, 0.1, True), (0.11, 0.1, False), (0.2, 0.0, False)]
    )
    def test_the_move_ends_above_bs_footprint(self, y, z, over):
        states = [self.at(0.0, 0.1, held=0, touching=HELD)] * 2 + [self.at(y, z, held=0, touching=HELD)] * 2
        assert ("move" in watch(self.monitor(), *states).reached) is over

    def test_progress_grows_on_the_way_and_while_it_is_lowered(self):
        way = [self.at(0.0, 0.05, held=0, touching=HELD)] * 2
        way += [self.at(y, 0.15, held=0, touching=HELD) for y in (0.05, 0.1, 0.15, 0.15)]
        way += [self.at(0.2, z, held=0, touching=HELD) for z in (0.15, 0.1, 0.05)]
        trace = watch(self.monitor(), *way, *[self.at(0.2, self.top, touching=self.on)] * 2).trace
        assert np.all(np.diff(trace) >= 0)
        assert 2 / 3 < trace[-3] < trace[-1] == 1.0


class TestPutIn:
    """A cube or a sponge, and a basket of 17 × 13.6 cm inside, 25 cm away."""

    basket, within = (0.0, 0.25, REST["basket"]), {(0, 1), (1, 0), (1, TABLE)}
    floor = REST["basket"] + BASKET.container.floor

    def monitor(self, a=CUBE) -> StateMonitor:
        return StateMonitor(PUT_IN, (a, BASKET), state((0.0, 0.0, REST[a.name]), self.basket))

    def at(self, x: float = 0.0, y: float = 0.25, height: float = 0.015, **more) -> State:
        return state((x, y, self.floor + height), self.basket, **{"touching": self.within} | more)

    @pytest.mark.parametrize(("x", "inside"), [(0.069, True), (-0.069, True), (0.08, False), (-0.08, False)])
    def test_the_whole_hull_must_be_inside_and_not_only_the_centre(self, x, inside):
        assert watch(self.monitor(), *[self.at(x)] * 2).success_once is inside

    def test_inside_turns_with_the_basket(self):
        across = {1: Rotation.from_euler("z", 90, degrees=True)}
        assert watch(self.monitor(), *[self.at(0.06)] * 2).success_once
        assert not watch(self.monitor(), *[self.at(0.06, turned=across)] * 5).success_once

    def test_what_leans_over_the_rim_is_not_inside(self):
        leaning = {0: Rotation.from_euler("y", 50, degrees=True)}
        monitor = watch(self.monitor(SPONGE), *[self.at(0.07, height=0.04, turned=leaning)] * 5)
        assert not monitor.success_once

    def test_it_must_be_released_in_it(self):
        assert not watch(self.monitor(), *[self.at(touching={(0, 1), (0, HAND)})] * 5).success_once


def test_the_nominal_wording_of_each_task_is_the_papers():
    first = {name: wordings[0] for name, wordings in load_wordings().items()}
    papers = ("pick up {a}", "move {a} near {b}", "put {a} on {b}", "put {a} into {b}")
    assert first == dict(zip(("pick-up", "move-near", "put-on", "put-in"), papers, strict=True))


@pytest.mark.parametrize("task", TASKS)
def test_there_are_ten_different_wordings_a_task_that_name_all_targets(task):
    wordings = set(load_wordings()[task])
    assert len(wordings) >= 10
    assert all("{a}" in wording and ("{b}" in wording) is (TASKS[task].targets > 1) for wording in wordings)
