"""Whether a world of values can be believed: checks of its resets, steps, values and pictures, each a sentence."""

import math
import random
import traceback
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import chain, combinations, pairwise, takewhile, zip_longest
from multiprocessing import get_context
from typing import Any, Self

import numpy as np

from vlafuzz.common.check import Check
from vlafuzz.common.deadline import Deadline
from vlafuzz.common.plugins import make_of
from vlafuzz.errors import UsageError, VlafuzzError, sentence
from vlafuzz.model import Conditions, Outcome, Scene, Verdict
from vlafuzz.worlds.base import World
from vlafuzz.worlds.parameters import Parameter, Value
from vlafuzz.worlds.values import ROBOT, ValuesWorld

STEPS = 40  # of a rollout with random actions, at most
SIMULATORS = 8  # that the brief checks make
SCENES, SECONDS, MOST = 20, 30.0, 3 / 4  # random scenes of the expert, until when one begins, the share to solve
PLACES = 9  # values of a range that are tried, evenly spaced
LONG = 180.0  # seconds after which no other value is begun: with pictures on a CPU, one may take minutes
SEED = 7
BEFORE_ALL = ("world", "resets", "steps", "repeats")  # checks without which the others mean nothing
GLOBAL = "it draws from numpy.random or random, which no seed reaches: draw from env.np_random"
MISTAKEN = "its unit is swapped, or it is clipped, ignored or mapped wrongly: look at apply and at applied"
Values = Mapping[str, Value]


@dataclass(frozen=True)
class Trace:
    """Fingerprints of a rollout, from its reset on; ``applied``: what the simulator says that it has."""

    states: tuple[bytes, ...]
    applied: Values
    solved: bool
    finite: bool

    def differs(self, other: Self) -> int | None:
        """The first step after which it is not as the other, 0 for the reset; None if there is none."""
        pairs = enumerate(zip_longest(self.states, other.states))
        return next((step for step, (mine, theirs) in pairs if mine != theirs), None)


def examine(world: World, task: str, reference: str = "", *, brief: bool = False) -> Iterator[Check]:
    """Check a world of values in one task, up to a finding after which others mean nothing: a last row names these.

    Args:
        reference: ``python:module:factory`` of the world, for a process of its own; empty to do without.
        brief: only the checks in nominal scenes, which take seconds and ``SIMULATORS`` simulators.
    """
    if not isinstance(world, ValuesWorld):
        raise UsageError("this world comes with vlafuzz, whose tests check it", hint="name one of your own")
    exam = _Exam(world, task, reference, brief=brief)
    others = (*([exam.processes] if reference else []), *(() if brief else (exam.values, exam.effects)))
    checks = (exam.resets, exam.steps, exam.repeats, *others, exam.nominal, exam.start, exam.expert, exam.pictures)
    with closing(exam.kept):
        for number, check in enumerate(checks, start=1):
            try:
                finding = check()
            except VlafuzzError as error:
                finding = Check("world", error.message, "refuse", error.hint or "")
            except Exception as error:  # of the user's code, or of the simulator
                frame = traceback.extract_tb(error.__traceback__)[-1]
                found = sentence(f"it raises {type(error).__name__}: {error}")
                finding = Check("world", found, "refuse", f"mend {frame.filename}, line {frame.lineno}")
            yield finding
            if finding.verdict == "refuse" and finding.check in BEFORE_ALL:
                if left := ", ".join(other.__name__ for other in checks[number:]):
                    yield Check("not checked", left, "warn", "mend what is refused first")
                return
    if exam.left:
        yield Check("not checked", f"the effects of {', '.join(exam.left)}", "warn", f"{LONG:g} s went to the others")


class _Exam:
    def __init__(self, world: ValuesWorld[Any], task: str, reference: str = "", *, brief: bool = False) -> None:
        self.world, self.task, self.reference, self.brief = world, task, reference, brief
        self.nominal_values = world.nominal_values
        self.kept = self._opened()  # for all values: a new renderer may take half a minute for its first picture
        self.left: list[str] = []  # parameters whose effects no time was left for
        self._levels, self._solving, self._drawing = cache(self._rolled_out), cache(self._solved), cache(self._drawn)

    @cached_property
    def pair(self) -> tuple[Trace, Trace]:
        """Two nominal rollouts, each in a new simulator."""
        return self._new(), self._new()

    def resets(self) -> Check:
        first, second = self.pair
        if first.differs(second) != 0:
            return Check("resets", "two new environments begin alike with the same values and seed")
        found = "two new environments begin differently with the same values and seed"
        return Check("resets", found, "refuse", self._unseeded("the seed is ignored: hand it to every generator"))

    def steps(self) -> Check:
        first, second = self.pair
        step = first.differs(second)
        if step is None and first.differs(self._new(actions=1)) is None:
            found = f"other actions lead to the same states for {len(first.states) - 1} steps"
            return Check("steps", found, "warn", "step ignores its action, or the space of actions is a point")
        if step is None:
            return Check("steps", f"the same actions lead to the same states for {len(first.states) - 1} steps")
        found = f"the same actions lead elsewhere after step {step}, with the same values and seed"
        return Check("steps", found, "refuse", self._unseeded("a step draws by chance: no time, no own generator"))

    def repeats(self) -> Check:
        usual, far = self.pair[0], self._far()
        with closing(self._opened()) as world:
            begun, again = (self._rollout(world, self.nominal_values, steps=0) for _ in range(2))
            _, after = (self._rollout(world, self.nominal_values) for _ in range(2))
        with closing(self._opened()) as world:
            away, *late = (self._rollout(world, far) for _ in range(3))
            back = self._rollout(world, self.nominal_values)
        if again.differs(begun) is not None:
            follows = "the seed is ignored: hand it to every generator at every reset"
            return Check("repeats", "a second reset with the same seed begins differently", "refuse", follows)
        if away.differs(late[0]) is not None and late[0].differs(late[1]) is None:
            follows = "what apply sets reaches the simulator at the next reset only"
            return Check("repeats", "the same values act differently at a second reset", "refuse", follows)
        if after.differs(usual) is not None or back.differs(usual) is not None:
            why = "a rollout" if after.differs(usual) is not None else "other values"
            follows = "the reset keeps something: reset it, or say fresh = True for a new environment each time"
            return Check("repeats", f"after {why} the nominal scene is another one", "refuse", follows)
        return Check("repeats", "a reset forgets the rollouts and values before it")

    def processes(self) -> Check:
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            there = pool.submit(_there, self.reference, self.task).result()
        step = self._new().differs(there)
        if step is None:
            return Check("processes", "another process has the same rollout")
        found = f"another process has another rollout, after step {step}"
        return Check("processes", found, "refuse", "no time, process id or hash() of texts in what is drawn")

    def values(self) -> Check:
        told = 0
        for one in (one for one in self.world.parameters if one.name in self.pair[0].applied):
            for value, trace in self._levels(one):
                told, has = told + 1, trace.applied.get(one.name, value)
                if not _equal(value, has):
                    found = f"{_named(one)}: {_said(one, value)} was set, the simulator has {_said(one, has)}"
                    return Check("values", found, "refuse", MISTAKEN)
        if not told:
            return Check("values", "the world reads none of them back: applied(now) would")
        return Check("values", f"{told} of them are read back as they were set")

    def effects(self) -> Check:
        idle, alike, until = [], [], Deadline(LONG)
        for one in self.world.parameters:
            if until.passed:
                self.left.append(one.name)
                continue
            traces = self._levels(one)
            if broken := [value for value, trace in traces if not trace.finite]:
                found = f"{_named(one)}: an observation is not finite at {_said(one, broken[0])}"
                return Check("effects", found, "refuse", "narrow the range, or mend step")
            if traces and one.name in traces[0][1].applied and not self.world.expert():
                continue  # it arrives, and random actions may never meet what it changes
            steps = list(pairwise(traces))
            ends = [self._differ(one, step) for step in steps[:1] + steps[-1:]]
            if steps and not any(ends) and not any(self._differ(one, step) for step in steps[1:-1]):
                idle.append(_named(one))
            elif one.options:
                pairs = [(a, b) for a, b in combinations(traces, 2) if not self._differ(one, (a, b))]
                alike += [f"{one.name}: {a[0]} and {b[0]} act alike" for a, b in pairs[:1]]
            elif not all(ends):
                same = [not self._differ(one, step) for step in steps]
                alike.append(_end(one, [value for value, _ in traces], same))
        if idle:
            expert = " and in the expert's rollout" if self.world.expert() else ""
            found = f"{', '.join(idle)}: no effect in {STEPS} steps of random actions{expert}, nor in a picture"
            return Check("effects", found, "warn", "look at how it is applied, or leave it out")
        if alike:
            return Check("effects", "; ".join(alike), "warn", "narrow the range to what is applied, or mend apply")
        seen = len(self.world.parameters) - len(self.left)
        return Check("effects", f"each of the {seen} values changes what happens")

    def nominal(self) -> Check:
        with closing(self._opened()) as world:
            state = world.own_start(SEED)
            if state is None:
                return Check("nominal", "the world has no start of its own to compare with")
            own = self._trace(world, state, STEPS)
        step = self.pair[0].differs(own)
        if step is None:
            return Check("nominal", "the nominal scene is the environment's own")
        told = [(one, own.applied[one.name]) for one in self.world.parameters if one.name in own.applied]
        pairs = [(one, has, self.nominal_values[one.name]) for one, has in told]
        said = [f"{_named(one)} is {_said(one, a)}, not {_said(one, b)}" for one, a, b in pairs if not _equal(b, a)]
        where = "from its reset on" if step == 0 else f"after step {step}"
        found = f"the nominal scene differs from the environment's own {where}{': ' * bool(said)}{', '.join(said)}"
        follows = "correct nominal or its unit, or say has_own_start = False if that is meant"
        return Check("nominal", found, "warn", follows)

    def start(self) -> Check:
        if self.pair[0].solved:
            return Check("start", "the nominal scene is solved before the first step", "refuse", "mend success(now)")
        for one in (one for one in self.world.parameters if not self.brief and one.name not in self.left):
            solved = [value for value, trace in self._levels(one) if trace.solved]
            if solved:
                found = f"{_named(one)}: the scene is solved before the first step at {_said(one, solved[0])}"
                return Check("start", found, "warn", "narrow the range, or let unfair(values) say so")
        return Check("start", "no scene is solved before the first step")

    def expert(self) -> Check:
        if self.world.expert() is None:
            return Check("expert", "the world has none")
        space, until = self.world.space(self.task, ROBOT), Deadline(SECONDS)
        drawn = (space.sample(np.random.default_rng([SEED, number])) for number in range(SCENES))
        shown = self._shown(chain([space.nominal()], takewhile(lambda _: not until.passed, drawn)))
        if next(shown).verdict is not Verdict.PASSED:
            follows = "no failure would be certified: mend solve or success, or raise horizon"
            return Check("expert", "it does not solve the nominal scene", "warn", follows)
        if self.brief:
            return Check("expert", "it solves the nominal scene")
        tried = [outcome.verdict is Verdict.PASSED for outcome in shown]
        found = f"it solves the nominal scene, and {sum(tried)} of {len(tried)} random scenes"
        few = sum(tried) < MOST * len(tried)
        return Check("expert", found, *(("warn", "narrow the range, or improve solve") if few else ()))

    def pictures(self) -> Check:
        world = self._opened()
        try:
            state = world.reset(self.nominal_values, SEED)
            drawn = [world.picture(state) for _ in range(2)]
            if drawn[0] is None or drawn[1] is None:
                return Check("pictures", "the world draws none")
            if drawn[0].ndim != 3 or drawn[0].dtype != np.uint8:
                found = f"a picture has the shape {drawn[0].shape} and {drawn[0].dtype}"
                return Check("pictures", found, "refuse", "expected (height, width, 3) and uint8")
            other = world.picture(world.reset(self.nominal_values, SEED))
            if other is None or not all(np.array_equal(drawn[0], again) for again in (drawn[1], other)):
                found = "the same moment is drawn differently a second time"
                return Check("pictures", found, "warn", "a policy that sees fails by chance, then")
            watched = self._rollout(world, self.nominal_values, draw=True)
            after = world.picture(world.reset(self.nominal_values, SEED))
            if after is None or not np.array_equal(drawn[0], after):
                found = "after a rollout, the first picture of the same scene is another one"
                return Check("pictures", found, "refuse", "a picture must show the present: update before it is drawn")
        except Exception as error:  # of the renderer
            found = sentence(f"drawing raises {type(error).__name__}: {error}")
            return Check("pictures", found, "refuse", "mend it, or let picture(now) return None")
        finally:
            world.close()
        if watched.differs(self.pair[0]) is not None:
            found = "what follows is another, if pictures are drawn meanwhile"
            follows = "render must change no state and draw from no generator; with MuJoCo, draw a copy of its data"
            return Check("pictures", found, "refuse", follows)
        return Check("pictures", f"{drawn[0].shape[1]} × {drawn[0].shape[0]} pixels, the same again")

    # How rollouts are made.

    def _opened(self) -> ValuesWorld[Any]:
        """The world with a simulator that nobody has used."""
        world = self.world.opened(self.task)
        world.close()
        return world

    def _new(self, actions: int = SEED) -> Trace:
        """A nominal rollout in a new simulator."""
        with closing(self._opened()) as world:
            return self._rollout(world, self.nominal_values, actions=actions)

    def _rollout(self, world: ValuesWorld[Any], values: Values, steps: int = STEPS, **how: Any) -> Trace:
        return self._trace(world, world.reset(dict(values), SEED), steps, **how)

    def _trace(
        self, world: ValuesWorld[Any], state: Any, steps: int, *, draw: bool = False, actions: int = SEED
    ) -> Trace:
        """Roll out from a state, by random actions that are the same for the same ``actions``."""
        rng, success = np.random.default_rng(actions), world.stages[-1]
        applied, held = dict(world.applied(state)), [success.holds(state)]
        states, finite = [world.fingerprint(state)], [bool(np.isfinite(world.observe(state)).all())]
        while len(states) <= min(steps, world.horizon) and not world.ended(state):
            if draw:
                world.picture(state)
            state = world.step(state, world.some_action(rng))
            states.append(world.fingerprint(state))
            finite.append(bool(np.isfinite(world.observe(state)).all()))
            held.append(success.holds(state))
        return Trace(tuple(states), applied, all(held[: success.steps]), all(finite))

    def _rolled_out(self, one: Parameter) -> list[tuple[Value, Trace]]:
        """Roll out with a value all over its range, the others nominal."""
        world, scenes = self.kept, [(value, self.nominal_values | {one.name: value}) for value in _spread(one)]
        return [(value, self._rollout(world, values)) for value, values in scenes if world.unfair(values) is None]

    def _differ(self, one: Parameter, pair: tuple[tuple[Value, Trace], tuple[Value, Trace]]) -> bool:
        """Whether two values of a parameter act differently, if need be in rollouts of the expert or in a picture."""
        (first, mine), (second, theirs) = pair
        looks = (self._solving, self._drawing)
        return mine.differs(theirs) is not None or any(look(one, first) != look(one, second) for look in looks)

    def _solved(self, one: Parameter, value: Value) -> list[str]:
        """Hash the states through which the expert goes with a value, the others nominal."""
        scene = self.world.scene(self.task, self.nominal_values | {one.name: value})
        return [outcome.rollouts[0].states_hash for outcome in self._shown([scene])]

    def _drawn(self, one: Parameter, value: Value) -> bytes:
        """The first picture with a value; none where drawing fails, which is a check of its own."""
        with suppress(Exception):
            if (drawn := self.kept.picture(self.kept.reset(self.nominal_values | {one.name: value}, SEED))) is not None:
                return drawn.tobytes()
        return b""

    def _shown(self, scenes: Iterable[Scene]) -> Iterator[Outcome]:
        """Roll out the expert in scenes; where there is none, in none."""
        expert, space = self.world.expert(), self.world.space(self.task, ROBOT)
        if expert is None:
            return
        conditions = Conditions(task=self.task, policy="expert", seed=SEED, **space.conditions)
        with closing(self.world.evaluator(conditions, expert, space, checked=False)) as evaluator:
            for scene in scenes:
                (outcome,) = evaluator.evaluate([scene])
                if outcome.verdict is Verdict.ERROR:
                    raise UsageError(f"in a rollout of the expert: {outcome.detail}", hint="mend solve")
                yield outcome

    def _far(self) -> dict[str, Value]:
        """A fair scene in which as much as possible is not nominal."""
        far = dict(self.nominal_values)
        for one in self.world.parameters:
            tries = (far | {one.name: value} for value in reversed(_spread(one)) if value != far[one.name])
            far = next((scene for scene in tries if self.world.unfair(scene) is None), far)
        return far

    def _unseeded(self, otherwise: str) -> str:
        """Why two rollouts differ: global generators, if they are alike with these seeded, or something else."""
        traces = []
        for _ in range(2):
            random.seed(SEED)
            np.random.seed(SEED)  # noqa: NPY002 - the very generator that a world must not use
            traces.append(self._new())
        return GLOBAL if traces[0].differs(traces[1]) is None else otherwise


def _there(reference: str, task: str) -> Trace:
    return _Exam(make_of(reference), task)._new()


def _spread(one: Parameter) -> list[Value]:
    if one.options:
        return list(one.options)
    grid = one.gene.grid
    levels = dict.fromkeys(int(level) for level in np.linspace(0, grid.size - 1, min(PLACES, grid.size)).round())
    return [one.told(grid.value(level)) for level in levels]


def _equal(value: Value, has: Value) -> bool:
    if isinstance(value, str) or isinstance(has, str):
        return value == has
    return math.isclose(value, has, rel_tol=1e-4, abs_tol=1e-6)


def _end(one: Parameter, values: list[Value], same: list[bool]) -> str:
    first = len(same) - [*reversed(same), False].index(False) if same[-1] else 0
    last = len(same) if same[-1] else [*same, False].index(False)
    return f"{_named(one)}: clipped, {_said(one, values[first])} to {_said(one, values[last])} act alike"


def _named(one: Parameter) -> str:
    return f"{one.name} ({one.says})" if one.says else one.name


def _said(one: Parameter, value: Value) -> str:
    return value if isinstance(value, str) else f"{value:.4g}{' ' * bool(one.unit)}{one.unit}"
