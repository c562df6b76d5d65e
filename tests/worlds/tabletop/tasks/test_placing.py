"""put-on and put-in, judged on states made by hand: no simulator."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.worlds.tabletop.tasks.states import BASKET, CUBE, HELD, PLATE, REST, SPONGE, state, watch
from vlafuzz.worlds.tabletop.tasks import ARM, HAND, PUT_IN, PUT_ON, TABLE, State, StateMonitor


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

    def test_published_success_counts_what_is_still_in_the_hand(self):
        monitor = watch(self.monitor(), *[self.at(0.2, self.top, held=0, touching=HELD)] * 5)
        assert (monitor.published_success, monitor.success_once) == (True, False)

    @pytest.mark.parametrize(("y", "z"), [(0.08, 0.03), (0.2, 0.06)])
    def test_published_success_needs_it_over_b_and_low(self, y, z):
        assert not watch(self.monitor(), self.at(y, z)).published_success

    @pytest.mark.parametrize(("lies", "counts"), [("upright", True), ("on its head", False)])
    def test_published_success_takes_what_is_on_its_head_for_less_high_than_flat(self, lies, counts):
        turned = {0: Rotation.from_euler("x", 0.0 if lies == "upright" else 180.0, degrees=True)}
        start = state((0.0, 0.0, 0.015), self.plate, turned=turned)
        monitor = StateMonitor(PUT_ON, (CUBE, PLATE), start)
        assert watch(monitor, self.at(0.2, self.top, turned=turned)).published_success is counts


class TestPutIn:
    """A cube or a sponge, and a basket of 17 × 13.6 cm inside, 25 cm away."""

    basket, within = (0.0, 0.25, REST["basket"]), {(0, 1), (1, 0), (1, TABLE)}
    floor = REST["basket"] + BASKET.container.floor

    def monitor(self, a=CUBE) -> StateMonitor:
        return StateMonitor(PUT_IN, (a, BASKET), state((0.0, 0.0, REST[a.name]), self.basket))

    def at(self, x: float = 0.0, y: float = 0.25, height: float = 0.015, **more) -> State:
        return state((x, y, self.floor + height), self.basket, **{"touching": self.within} | more)

    def test_lying_inside_is_success(self):
        monitor = watch(self.monitor(), *[self.at()] * 2)
        assert (monitor.success_once, monitor.reached) == (True, ["grasp", "move", "success"])

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

    @pytest.mark.parametrize(
        "more",
        [{"touching": {(0, 1), (0, HAND)}}, {"touching": {(0, 1), (0, TABLE)}}, {"touching": set()}, {"speed": 0.02}],
        ids=["in the hand", "on the table", "touching nothing", "moving"],
    )
    def test_it_must_be_released_and_at_rest_in_it(self, more):
        assert not watch(self.monitor(), *[self.at(**more)] * 5).success_once

    def test_published_success_counts_what_hovers_above_the_basket(self):
        monitor = watch(self.monitor(), *[self.at(height=0.08, held=0, touching=HELD)] * 5)
        assert (monitor.published_success, monitor.success_once) == (True, False)
