"""What worlds share whose scenes are things on a table, seen by a camera under lamps: space, world, words."""

import math
from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from vlafuzz.errors import UsageError
from vlafuzz.model import Camera, Gene, Placement, Scene, Setting, Space, Task, scene as model
from vlafuzz.model.genes import embedded
from vlafuzz.model.phrasing import beyond
from vlafuzz.model.scene import in_words
from vlafuzz.model.space import CONFOUNDERS, Composer, Range, Values, Vector
from vlafuzz.worlds.base import SceneMap, World
from vlafuzz.worlds.events import newcomer
from vlafuzz.worlds.manipulation import extras, operators as kinds
from vlafuzz.worlds.manipulation.composer import camera
from vlafuzz.worlds.manipulation.jitter import jittered, polar
from vlafuzz.worlds.manipulation.operator_set import MIN_DISTANCE, VISIBLE, OperatorSet, load_operators
from vlafuzz.worlds.manipulation.rigs import Rig, View, rig

_STILL = 0.0005  # metres: half a step of the camera's distance
_GRID = 4  # rows and columns of the workspace in a site
# The targets' types are in no group: they are what a failure is about.
_AROUND = (kinds.ConfounderType, kinds.ConfounderPosition, kinds.ConfounderOrientation, kinds.ConfounderCount)
_SEEN = (kinds.Light, kinds.CameraPosition, kinds.CameraOrientation, kinds.Wording)
_PLACED = (kinds.TargetOrientation, kinds.TargetPosition)
GROUPS: dict[str, tuple[str, ...]] = {
    CONFOUNDERS: tuple(kind.name for kind in _AROUND),
    **{kind.name: (kind.name,) for kind in (*_SEEN, *_PLACED)},
    **{name: (name,) for name in kinds.OPERATORS if name in extras.EXTRAS},
}
REDRAWS = 60  # positions tried for one object
RESTARTS = 200  # attempts at a scene
HINT = "widen the ranges, or lower min_distance, confounder-count or visible, in your own --operators file"
# Words that say how the camera is turned by each angle, where it is positive and where it is negative.
_TURNED = {
    "pitch": ("the camera tilts down by {}", "the camera tilts up by {}"),
    "yaw": ("the camera turns left by {}", "the camera turns right by {}"),
    "roll": ("the camera rolls right by {}", "the camera rolls left by {}"),
}
_PAINTED = {"table": "the table's pattern is {}", "colour": "the table is {}", "wall": "the wall is {}"}
# By direction, as whoever looks through the camera sees it: in words, and the opposite one.
_WAYS = {"to the left": ("to the left ←", "to the right →"), "up": ("up ↑", "down ↓"), "back": ("back", "forward")}
# When an event happens, as a sentence goes on.
_MOMENTS: Mapping[model.Moment, str] = {
    "start": "a second after the start",
    "approach": "while the hand approaches",
    "grasp": "once the target is grasped",
    "carry": "while the target is carried",
}
model.UNITS.update(dict.fromkeys(_WAYS, " cm"))


class TableSpace(Space):
    """Every scene that the operators can make of a task at a robot's table.

    ``operators``: those of the task, where it has ranges of its own.
    """

    operators: OperatorSet
    groups, subject = GROUPS, kinds.TargetType.name
    # A confounder may stand where a target belongs, and the target where that confounder does.
    blocking = (kinds.TargetPosition.name, kinds.ConfounderPosition.name)

    def __init__(self, task: Task, rig: Rig, operators: OperatorSet, composer: Composer) -> None:
        super().__init__(task, rig.robot, operators, composer)
        self.rig = rig
        self._turned = [gene for gene in self.genes if gene.operator != kinds.CameraPosition.name]
        moved = [gene for gene in self.genes if gene.path == "camera.distance"]
        self._farthest = moved[0].grid.high if moved else 0.0

    @property
    def conditions(self) -> dict[str, Any]:
        return self.operators.conditions

    def embed(self, scene: Scene) -> Vector:
        """Embed a scene, see ``Space.embed``; the camera's position is a point in space."""
        values = self._composer.values(scene)
        numbers = embedded(self._turned, values)
        if self._farthest:
            numbers += [number / (2 * self._farthest) for number in camera(values).offset]
        return np.array(numbers)

    def jittered(self, scene: Scene, number: int) -> Scene:
        return jittered(scene, number)

    def site(self, scene: Scene, severities: Mapping[str, float]) -> str:
        """``camera-position+light|x0y3``: with the first target's position in a 4 × 4 grid."""
        target, workspace = scene.targets[0], self.rig.workspace
        column, row = _bin(target.x, workspace.x), _bin(target.y, workspace.y)
        return f"{super().site(scene, severities)}|x{column}y{row}"

    def things(self, scene: Scene) -> Sequence[Placement]:
        return scene.confounders

    def with_things(self, scene: Scene, things: Sequence[Any]) -> Scene:
        return replace(scene, confounders=tuple(things))

    def subjects(self, scene: Scene) -> Sequence[str]:
        slots = {gene.slot for gene in self.by_path.values() if gene.operator == kinds.TargetType.name}
        return [_name(one) for slot, one in enumerate(scene.targets) if f"targets.{slot}" in slots]

    def direction(self, scene: Scene, operators: str, start: Scene) -> str | None:
        """See ``Space.direction``; confounders have their number and, if it matters, their kinds: ``1,can``."""
        if operators == CONFOUNDERS:
            others = self.reset(scene, [kinds.ConfounderType.name], start).confounders
            pairs = zip(scene.confounders, others, strict=True)
            changed = {one.object.rpartition("_")[2] for one, other in pairs if one.object != other.object}
            return ",".join([str(len(scene.confounders)), *sorted(changed)])
        if operators == kinds.Light.name:
            return "dark" if scene.light.intensity < start.light.intensity else "bright"
        if operators == kinds.CameraPosition.name:  # the axis along which it is farthest off
            axes = self.axes(scene, operators, start) or {"x": 0.0}
            axis = max(axes, key=lambda axis: abs(axes[axis]))
            return f"{'-' if axes[axis] < 0 else '+'}{axis}"
        return None

    def axes(self, scene: Scene, group: str, start: Scene) -> Mapping[str, float]:
        """See ``Space.axes``; the camera's position has x, y and z, in metres."""
        if group != kinds.CameraPosition.name:
            return {}
        offsets = zip("xyz", scene.camera.offset, start.camera.offset, strict=True)
        return {axis: here - there for axis, here, there in offsets if abs(here - there) > _STILL}

    def without_axes(self, scene: Scene, group: str, axes: Collection[str], start: Scene) -> Scene:
        offsets = zip("xyz", scene.camera.offset, start.camera.offset, strict=True)
        moved = polar(*(there if axis in axes else here for axis, here, there in offsets))
        paths = [f"camera.{name}" for name in ("distance", "azimuth", "elevation")]
        grids = [self.by_path[path].grid for path in paths]
        placed = {path: grid.value(grid.snap(value)) for path, grid, value in zip(paths, grids, moved, strict=True)}
        return self.compose(self.values(scene) | placed)

    def option(self, scene: Scene, gene: Gene, value: float) -> str:
        if gene.path.startswith("targets.") and gene.path.endswith(".rest"):
            slot = gene.slot.partition(".")[2]
            return scene.targets[int(slot)].rest + (str(int(slot) + 1) if slot != "0" else "")
        return super().option(scene, gene, value)

    def described(self, scene: Scene, operators: str, other: Scene) -> str:
        if operators == CONFOUNDERS:
            same = scene.confounders == other.confounders
            placed = [f"{_name(one)} at x {one.x:g} m, y {one.y:g} m" for one in scene.confounders]
            return "" if same else "; ".join(placed) or "none"
        if operators == kinds.Light.name:
            return "" if scene.light == other.light else f"× {scene.light.intensity:.3g}"
        if operators == kinds.CameraPosition.name:
            return "" if scene.camera.offset == other.camera.offset else _moved(self.rig.view, scene.camera)
        if operators == kinds.CameraOrientation.name:
            return _fields(scene.camera, other.camera, ("roll", "pitch", "yaw"))
        if operators == kinds.Wording.name:
            return "" if scene.instruction == other.instruction else f"“{scene.instruction}”"
        kind = kinds.OPERATORS[operators]
        if issubclass(kind, extras.Extra) and kind.part != "targets":
            shown, usual = getattr(scene, kind.part), getattr(other, kind.part)
            if isinstance(shown, model.Event) and shown == model.EVENTS[kind.part]:
                return "" if shown == usual else "never"
            said = _fields(shown, usual, [field.name for field in fields(shown) if field.name != "when"])
            differs = isinstance(shown, model.Event) and shown != usual
            return f"{said} {_MOMENTS[shown.when]}".strip() if differs else said
        return self._targets(operators, scene.targets, other.targets)

    def clause(self, scene: Scene, group: str, other: Scene, fails: Sequence[Range] = ()) -> str:
        if group == CONFOUNDERS and not fails:
            names = [_name(placement) for placement in scene.confounders]
            return f"{' and '.join(names) or 'nothing else'} {'are' if len(names) > 1 else 'is'} on the table"
        if group == kinds.CameraPosition.name and all("camera.distance" in dict(low) for low, _ in fails):
            far = " or ".join(_distances(dict(low), dict(high)) for low, high in fails)
            return f"the camera is {_moved(self.rig.view, scene.camera, far)}"
        if issubclass(kind := kinds.OPERATORS[self.group(group)[0]], extras.EventOperator):
            event, usual = getattr(scene, kind.part), self.values(other)
            size = " or ".join(beyond(low, high, usual) for low, high in fails)
            names = [field.name for field in fields(event) if field.name not in ("when", "rest", "direction", "thing")]
            here = _fields(event, model.EVENTS[kind.part], names)
            how = f" {kind.by} {size}" if size else f" ({here})" if here else ""
            late = newcomer(scene)
            if group == "camera-bump":
                return f"{self._turns(scene, other, fails, kind.part)} {_MOMENTS[event.when]}"
            happens = kind.happens if late is None else kind.happens.format(newcomer=_name(scene.placements[late]))
            return f"{happens}{how} {_MOMENTS[event.when]}"
        if group == kinds.CameraOrientation.name:
            return self._turns(scene, other, fails, "camera")
        if group == "backdrop" and scene.backdrop != other.backdrop:
            changed = (part for part in _PAINTED if getattr(scene.backdrop, part) != getattr(other.backdrop, part))
            return " and ".join(_PAINTED[part].format(getattr(scene.backdrop, part)) for part in changed)
        if group in (kinds.TargetPosition.name, kinds.TargetOrientation.name) and not fails:
            said = self.described(scene, group, other).replace("yaw", "turned to").replace("; ", " and ")
            named = said if ":" in said else f"the target: {said}"  # of several targets each has its name
            if group == kinds.TargetPosition.name:
                return named.replace(": ", " is at ")
            return named.replace(": rests", " rests").replace(": ", " is ")
        return super().clause(scene, group, other, fails)

    def _turns(self, scene: Scene, other: Scene, fails: Sequence[Range], part: str) -> str:
        """The turns of the camera by a part of the scene in words, for ``clause``."""
        values, usual = self.values(scene), self.values(other)
        ways = []
        for path in dict(fails[0][0]) if fails else [f"{part}.{angle}" for angle in _TURNED]:
            if values[path] != usual[path]:
                own = [[tuple(end for end in ends if end[0] == path) for ends in pair] for pair in fails]
                amounts = [beyond(low, high, usual, away=True) for low, high in own] or [f"{abs(values[path]):g}°"]
                ways.append(_TURNED[path.partition(".")[2]][values[path] < usual[path]].format(" or ".join(amounts)))
        return " and ".join(ways).replace(" and the camera", " and")

    def derived(self, scene: Scene) -> Mapping[tuple[str, str], float]:
        ways = seen_from(self.rig.view, scene.camera)
        return {(kinds.CameraPosition.name, way): round(100 * far, 2) + 0.0 for way, far in ways.items()}

    def _targets(self, operator: str, targets: Sequence[Placement], others: Sequence[Placement]) -> str:
        slots = {gene.slot for gene in self.by_path.values() if gene.operator == operator}
        parts = []
        for number, (target, other) in enumerate(zip(targets, others, strict=False)):
            if f"targets.{number}" in slots and (words := _words(operator, target, other)):
                parts.append((f"{_name(target)}: " if len(targets) > 1 else "") + ", ".join(words))
        return "; ".join(parts)


def _bin(value: float, bounds: tuple[float, float]) -> int:
    low, high = bounds
    share = (value - low) / (high - low)
    return int(min(max(share * _GRID, 0), _GRID - 1))


def _words(operator: str, target: Placement, other: Placement) -> list[str]:
    words = []
    moved = (target.x, target.y) != (other.x, other.y)
    if operator in (kinds.TargetPosition.name, extras.BystanderPosition.name) and moved:
        words.append(f"x {target.x:g} m, y {target.y:g} m")
    if operator in (kinds.TargetOrientation.name, extras.BystanderOrientation.name):
        if target.rest != other.rest:
            words.append(f"rests {target.rest}")
        if target.yaw != other.yaw:
            words.append(f"yaw {target.yaw:g}°")
        if target.quaternion != other.quaternion:
            words.append("turned freely" if target.quaternion else f"rests {target.rest}")
    return words


def _name(placement: Placement) -> str:
    return placement.object.replace("_", " ")


def seen_from(view: View, camera: Camera) -> dict[str, float]:
    """How far a camera is off, as whoever looks through it sees it: metres to the left, up and back."""
    ahead = math.atan2(view.target[1] - view.eye[1], view.target[0] - view.eye[0])
    x, y, z = camera.offset
    forward, left = x * math.cos(ahead) + y * math.sin(ahead), y * math.cos(ahead) - x * math.sin(ahead)
    return {"to the left": left, "up": z, "back": -forward}


def _moved(view: View, camera: Camera, far: str = "") -> str:
    """``2 cm to the left ←, 1 cm up ↑``, without what is small beside the largest; ``far`` replaces the amounts."""
    ways = seen_from(view, camera)
    most = max(map(abs, ways.values()))
    if most < _STILL:
        return "in its place"
    said = {way: _WAYS[way][value < 0] for way, value in ways.items() if abs(value) > most / 5}
    if far:
        return f"{far} {' and '.join(said.values())}"
    return ", ".join(f"{100 * abs(ways[way]):.2g} cm {words}" for way, words in said.items())


def _distances(low: Values, high: Values) -> str:
    nearest, *farthest = (f"{100 * ends['camera.distance']:.3g} cm" for ends in (low, high) if ends)
    return f"{nearest} to {farthest[0]}" if farthest else f"at least {nearest}"


def _fields(part: object, other: object, names: Sequence[str]) -> str:
    differing = [name for name in names if getattr(part, name) != getattr(other, name)]
    return ", ".join(in_words(name, getattr(part, name)) for name in differing)


def maps_of_targets(targets: int, what: str = "stands") -> list[SceneMap]:
    """Where the targets are, as one sees them who stands opposite the robot."""
    names = ("the target", *(f"target {number}" for number in range(2, targets + 1)))
    return [
        SceneMap(
            title=f"Where {name} {what}, from above",
            across=f"targets.{slot}.y",
            along=f"targets.{slot}.x",
            mirrored=True,
            below="robot",
        )
        for slot, name in enumerate(names[:targets])
    ]


class TableWorld(World):
    """A world whose robots are rigs, and whose operators come from files of ranges."""

    settings: Sequence[Setting[Any]] = (MIN_DISTANCE, VISIBLE)

    def robot(self, name: str) -> Rig:
        return rig(name)

    def space(
        self, task: str, robot: str, operators: str | None = None, vary: Sequence[str] = (), packs: Sequence[Any] = ()
    ) -> TableSpace:
        ranges = load_operators(operators or rig(robot).operators)
        space = self.space_of(task, robot, ranges.only(vary) if vary else ranges, packs)
        offered = {gene.operator for gene in space.by_path.values()}
        idle = space.operators.varied - offered
        if idle and space.genes:  # some of a world's tasks lack what varies there by default, or some of all events
            idle -= load_operators(space.rig.operators).varied.union(extras.EVENTS if "events" in vary else ())
        for name in sorted(idle):
            hint = f"known: {', '.join(sorted(offered))}"
            raise UsageError(f"{name}: nothing of {space.task.name} varies so", hint=hint)
        lit = {kinds.Light.name, "light-switch"} & space.operators.varied or ranges.get(
            kinds.Light
        ).intensity.nominal != 1
        if "exposure" in vary and not lit:
            raise UsageError("exposure: it follows the light, which does not vary", hint="vary light as well")
        return space

    def maps(self, task: str) -> list[SceneMap]:
        return maps_of_targets(self.task(task).targets)

    @abstractmethod
    def space_of(self, task: str, robot: str, operators: OperatorSet, packs: Sequence[Any]) -> TableSpace:
        """The scenes of a task with these operators."""

    def listed_operators(
        self, source: str | None, task: str | None, robot: str | None, packs: Sequence[Any]
    ) -> tuple[str, list[dict[str, str]], list[str]]:
        setup = rig(robot or next(iter(self.robots)))
        chosen = load_operators(source or setup.operators)
        if task is not None:
            self.space(self.task(task).name, setup.robot, source, packs=packs)
            chosen = chosen.in_task(task.rpartition("/")[2])
        rows = [
            {
                "operator": name,
                "changes": operator.says,
                "range": operator.ranges(),
                "nominal": operator.nominally(),
                "varies": "yes" if name in chosen.varied else "no",
            }
            for name, operator in chosen.operators.items()
        ]
        bounds = f"a target counts as visible with at least {chosen.visible}"
        seen = bounds if chosen.visible else "targets need not be visible"
        apart = f"{chosen.min_distance:g} m between the centres of any two objects"
        title = f"{chosen.source.stem}: {apart}; {seen}"
        return title, rows, sorted(chosen.tasks) if task is None else []
