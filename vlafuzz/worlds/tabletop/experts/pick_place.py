"""Pick-and-place controller: grasp an object at its believed pose, move it to the goal, check, retry."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.worlds.manipulation.rigs import Rig
from vlafuzz.worlds.tabletop.experts import planning
from vlafuzz.worlds.tabletop.experts.planning import Goal, Reach, Thing
from vlafuzz.worlds.tabletop.tasks import kind

STEP = 0.10  # metres in a control step
TURN = 0.6  # radians in a control step
TILT = 0.1  # radians: the largest tilt error of a hand that counts as upright
OPEN, CLOSE = 1.0, -1.0
HOVER = 0.06  # metres above the grasp, and at least with the fingertips above the object's top
LEVEL = 0.004  # metres of horizontal error below which the hand descends
ALIGNED = 0.06  # radians of yaw error below which the hand descends
PATIENCE = 4  # control steps to close, or to wait without progress
GENTLE = 0.012  # metres per step at the end of lowering and at the start of retreating
FINGERTIP = 0.012  # metres from the TCP down to the fingertips


@dataclass(frozen=True, eq=False, kw_only=True)
class Belief:
    """Where things are, as far as the policy knows."""

    a: Thing  # the object to take
    b: Thing | None  # its destination; None for pick-up
    others: tuple[Thing, ...]  # obstacles
    tcp: Array  # (3,) metres
    tcp_rotation: Array  # (3, 3)
    held: bool  # something is between the fingers
    done: bool = False  # the task looks solved, so that no retry is needed

    @property
    def around(self) -> tuple[Thing, ...]:
        return (*self.others, *((self.b,) if self.b else ()))


Phase = Callable[[Belief], Array]  # gives actions (7,)


class Steering:
    """Keeps the hand pointing down, ``lean`` radians off the vertical; positive leans towards the robot."""

    def __init__(self, rig: Rig, lean: float) -> None:
        self._rig, self._lean = rig, lean

    def behind(self, place: Array, height: float) -> Array:
        """``(2,)`` horizontal offset, metres, of a leaning hand ``height`` metres above ``place``."""
        return np.asarray(-math.tan(self._lean) * height * self._outward(place))

    def toward(self, belief: Belief, target: Array, yaw: float, gripper: float) -> Array:
        """``(7,)`` the action that moves the TCP towards ``target`` and turns the closing axis to ``yaw``."""
        shift, lead = target - belief.tcp, self._rig.hand.lead
        length = math.hypot(*shift)
        shift = shift * (STEP / length if length * lead > STEP else lead)
        x, y, z = self._tilt(belief)
        turn = np.array([x, y, z + min(max(yaw - self.yaw(belief), -TURN), TURN)])
        return np.array([*shift, *(turn * lead), gripper])

    def yaw(self, belief: Belief) -> float:
        """Direction of the closing axis, within half a turn of the neutral one: the last joint has limits."""
        yaw = math.atan2(belief.tcp_rotation[1, 1], belief.tcp_rotation[0, 1])
        neutral = self._rig.neutral_yaw(*belief.tcp[:2])
        return neutral + (yaw - neutral + np.pi) % (2 * np.pi) - np.pi

    def upright(self, belief: Belief) -> bool:
        """Whether the hand has its intended tilt; where it leans, the tilt lags behind while it moves."""
        return self._rig.hand.straight == math.inf or math.hypot(*self._tilt(belief)[:2]) < TILT

    def _tilt(self, belief: Belief) -> Array:
        """``(3,)`` rotation vector from the hand's direction to the intended one."""
        tcp = belief.tcp
        distance = math.dist(tcp[:2], self._rig.base[:2])
        lean = self._lean + self._rig.hand.lean(distance, float(tcp[2]))
        wanted = np.array([*(math.sin(lean) * self._outward(tcp)), -math.cos(lean)])
        return np.cross(belief.tcp_rotation[:, 2], wanted)

    def _outward(self, place: Array) -> Array:
        """``(2,)`` unit vector from the robot to a place."""
        shift = place[:2] - np.asarray(self._rig.base[:2])
        return np.asarray(shift / np.linalg.norm(shift))


class PickPlaceController:
    """Grasps and places in one rollout. Actions are metric, relative to the hand's current pose.

    ``fluent``: never wait, and descend while still aligning: actions then hardly depend on the past, so that a
    memoryless policy can learn them. ``attempt``: rank of the first grasp. ``lean``: see ``Steering``.
    """

    def __init__(self, task: str, rig: Rig, *, fluent: bool = False, attempt: int = 0, lean: float = 0.0) -> None:
        self._task, self._rig, self._fluent = kind(task), rig, fluent
        self._hand = Steering(rig, lean)
        self._phase: Phase = self._approach
        self.attempt = attempt
        self._waited = 0
        self._plan: Reach | None = None
        self._planned_for: Array = np.zeros(3)
        self._goal: Goal | None = None
        self._last_tcp: Array = np.full(3, np.inf)

    def act(self, belief: Belief) -> Array:
        """The next action, ``(7,)``."""
        action = self._phase(belief)
        self._last_tcp = belief.tcp
        return action

    # phases, in their order

    def _approach(self, belief: Belief) -> Array:
        if self._fluent and belief.held:  # another controller grasped it
            return self._take(belief)
        reach = self._choose(belief)
        over = np.array([reach.x, reach.y, max(reach.z + HOVER, belief.a.top + FINGERTIP + 0.015)])
        over[:2] += self._hand.behind(over, over[2] - reach.z)
        self._keep_clear(belief, over)
        self._waited += 1
        patient = LEVEL if self._waited < 3 * PATIENCE else 3 * LEVEL
        if _level(over, belief.tcp) < patient and self._turned(belief, reach.yaw):
            return self._enter(self._descend, belief)
        if self._fluent:
            over[2] -= HOVER * self._in_place(belief, over, reach.yaw)
        return self._hand.toward(belief, over, reach.yaw, OPEN)

    def _descend(self, belief: Belief) -> Array:
        reach = self._choose(belief)
        down = np.array([reach.x, reach.y, reach.z])
        self._waited += 1
        upright = self._hand.upright(belief)
        if (upright and abs(belief.tcp[2] - reach.z) < 0.006) or self._waited > PATIENCE:
            return self._enter(self._close, belief)
        return self._hand.toward(belief, down, reach.yaw, OPEN)

    def _close(self, belief: Belief) -> Array:
        self._waited += 1
        if belief.held and self._waited >= (2 if self._fluent else 3):
            return self._take(belief)
        if self._waited > PATIENCE + 1:
            return self._retry(belief)
        assert self._plan is not None
        hold = np.array([*belief.tcp[:2], self._plan.z])
        return self._hand.toward(belief, hold, self._plan.yaw, CLOSE)

    def _lift(self, belief: Belief) -> Array:
        if not belief.held:
            return self._retry(belief)
        if self._goal is None and belief.b:  # the destination has only now become known
            self._aim(belief)
        if self._goal is None:
            up = np.array([*self._taken_at[:2], self._taken_at[2] + 0.12])
            return self._hand.toward(belief, up, self._yaw, CLOSE)
        height = self._carry_height(belief)
        if belief.tcp[2] > height - 0.015:
            return self._enter(self._carry, belief)
        return self._hand.toward(belief, np.array([*self._taken_at[:2], height]), self._yaw, CLOSE)

    def _carry(self, belief: Belief) -> Array:
        if not belief.held:
            return self._retry(belief)
        if self._fluent and self._task == "move-near" and belief.b is not None:  # depends on where a is now
            self._goal, self._b_was = self._find_goal(belief), belief.b.position[:2].copy()
        assert self._goal is not None
        over = np.array([*self._target_xy(belief), max(self._carry_height(belief), 0.0)])
        self._waited += 1
        level = _level(over, belief.tcp)
        if (level < LEVEL or (self._waited > 2 * PATIENCE and level < 0.02)) and self._turned(belief, self._goal_yaw):
            return self._enter(self._lower, belief)
        if self._fluent:
            air = max(float(over[2]) - self._goal.floor - self._hang - 0.03, 0.0)
            over[2] -= air * self._in_place(belief, over, self._goal_yaw)
        return self._hand.toward(belief, over, self._goal_yaw, CLOSE)

    def _lower(self, belief: Belief) -> Array:
        if not belief.held:
            return self._retry(belief)
        assert self._goal is not None
        floor = self._goal.floor + self._hang
        air = float(belief.tcp[2] - floor)
        self._waited += 1
        stalled = self._waited > 2 and air < 0.03 and self._last_tcp[2] - belief.tcp[2] < 0.003
        if air < 0.004 or stalled:
            return self._enter(self._release, belief)
        down = min(air, STEP) if air > 0.05 else min(air + 0.004, GENTLE)
        below = np.array([*self._target_xy(belief), belief.tcp[2] - (air - 0.03 if air > 0.05 else down)])
        return self._hand.toward(belief, below, self._goal_yaw, CLOSE)

    def _release(self, belief: Belief) -> Array:
        self._waited += 1
        if self._waited > 2:
            return self._enter(self._retreat, belief)
        assert self._goal is not None
        return self._hand.toward(belief, belief.tcp, self._goal_yaw, OPEN)

    def _retreat(self, belief: Belief) -> Array:
        assert self._goal is not None
        self._waited += 1
        if self._waited > 2 * PATIENCE and not belief.done:
            return self._retry(belief)
        height = self._goal.floor + self._hang + 0.12
        if self._waited <= 3:  # a fast start swings the fingers sideways, and a can rolls away
            height = min(height, belief.tcp[2] + GENTLE)
        return self._hand.toward(belief, np.array([*belief.tcp[:2], height]), self._goal_yaw, OPEN)

    # what the phases share

    def _enter(self, phase: Phase, belief: Belief) -> Array:
        self._phase, self._waited = phase, 0
        return phase(belief)

    def _retry(self, belief: Belief) -> Array:
        self.attempt += 1
        self._plan = None
        self._phase, self._waited = self._approach, 0
        up = np.array([*belief.tcp[:2], belief.tcp[2] + 0.08])
        return self._hand.toward(belief, up, self._hand.yaw(belief), OPEN)

    def _choose(self, belief: Belief) -> Reach:
        if self._plan is None or math.dist(belief.a.position, self._planned_for) > 0.004:
            grasps = planning.reaches(belief.a, belief.around, self._hand.yaw(belief), self._rig)
            if self._plan is not None and grasps:  # it moved a little: keep to the same kind of grasp
                yaw, nearest = self._plan.yaw, planning.nearest_yaw
                self._plan = min(grasps, key=lambda grasp: abs(nearest(grasp.yaw, yaw) - yaw) + 0.2 * grasp.cost)
            else:
                self._plan = grasps[self.attempt % len(grasps)] if grasps else self._blind(belief)
            self._planned_for = belief.a.position.copy()
        return self._plan

    def _blind(self, belief: Belief) -> Reach:
        """A grasp of the centre when none fits the object's pose: the attempt may turn it over."""
        x, y, z = belief.a.position
        height, yaw = max(float(z), 0.015), self._hand.yaw(belief)
        return Reach(x=float(x), y=float(y), z=height, yaw=yaw, width=0.07, cost=9.0)

    def _in_place(self, belief: Belief, over: Array, yaw: float) -> float:
        """Share of the descent that is allowed already, in [0, 1]; 0 at errors above 12 mm or 0.15 rad."""
        aside = max(_level(over, belief.tcp) - LEVEL, 0.0) / 0.008
        turn = max(abs(yaw - self._hand.yaw(belief)) - ALIGNED, 0.0) / 0.09
        return 1.0 - min(max(aside, turn), 1.0)

    def _turned(self, belief: Belief, yaw: float) -> bool:
        return abs(yaw - self._hand.yaw(belief)) < ALIGNED or self._waited > 3 * PATIENCE

    def _keep_clear(self, belief: Belief, over: Array) -> None:
        """While ``over`` is far, raise it above the obstacles on the path."""
        if _level(over, belief.tcp) < 0.02:
            return
        needed = planning.travel_height(belief.tcp[:2], over[:2], belief.around, 0.07) + FINGERTIP
        if needed > over[2]:
            over[2] = needed
        if belief.tcp[2] < over[2] - 0.03:
            over[:2] = belief.tcp[:2]

    def _take(self, belief: Belief) -> Array:
        a = belief.a
        self._yaw = self._hand.yaw(belief)
        self._taken_at = belief.tcp.copy()
        self._offset = a.position[:2] - belief.tcp[:2]
        self._hang = float(belief.tcp[2] - a.corners[:, 2].min())
        self._radius = float(np.linalg.norm(a.corners[:, :2] - a.position[:2], axis=1).max())
        self._aim(belief)
        return self._enter(self._lift, belief)

    def _aim(self, belief: Belief) -> None:
        self._goal = self._find_goal(belief)
        self._b_was = belief.b.position[:2].copy() if belief.b else np.zeros(2)
        self._goal_yaw = self._yaw
        if self._goal is not None:
            neutral = self._rig.neutral_yaw(*self._goal.place)
            self._goal_yaw = planning.nearest_yaw(self._yaw + self._goal.turn, neutral)

    def _find_goal(self, belief: Belief) -> Goal | None:
        if self._task == "pick-up" or belief.b is None:
            return None
        if self._task == "move-near":
            a, b, others = belief.a, belief.b, belief.others
            return planning.goal_near(a, b, others, self._yaw, self._rig, in_view=self._fluent)
        goal = planning.goal_in if self._task == "put-in" else planning.goal_on
        return goal(belief.a, belief.b)

    def _target_xy(self, belief: Belief) -> Array:
        assert self._goal is not None
        drift = belief.b.position[:2] - self._b_was if belief.b else np.zeros(2)
        turn = self._goal_yaw - self._yaw
        cosine, sine = np.cos(turn), np.sin(turn)
        turned = np.array([[cosine, -sine], [sine, cosine]]) @ self._offset
        return np.asarray(self._goal.place + drift - turned)

    def _carry_height(self, belief: Belief) -> float:
        assert self._goal is not None
        start, end, radius = self._taken_at[:2], self._goal.place, self._radius + 0.02
        clear = planning.travel_height(start, end, belief.around, radius)
        return max(clear, self._goal.floor + 0.04) + self._hang


def _level(a: Array, b: Array) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])
