"""The operators that are off by default: what a scene may have besides, and what happens in mid-episode."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from types import GenericAlias
from typing import Any, ClassVar, Self, TypeVar, get_type_hints

from pydantic import Field, create_model, model_validator

from vlafuzz.model import Gene, Grid, scene as model
from vlafuzz.model.scene import amount, in_words
from vlafuzz.worlds.manipulation.base import Layout, Operator, Span
from vlafuzz.worlds.manipulation.rigs import Rig

SELDOM = 0.2  # of the scenes have an event that has no amount: it is kept where others are too many
Options = Span | tuple[str, ...]
Kind = TypeVar("Kind", bound="Extra")


class Extra(Operator):
    """An operator that is off by default, of a part of scenes; see ``_of_part``.

    Nominal is the default of the part's field. While the operator does not vary, digests of operator sets and stored
    operators leave it out; a file that leaves it out gets the ranges of ``tabletop.yaml``.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (self.name, dict(self))  # pickle would look for a class of that name

    def spans(self, rig: Rig) -> Mapping[str, Options]:
        """The range of each field that this rig has."""
        return dict(self)

    def genes(self, layout: Layout) -> Iterator[Gene]:
        for field, span in self.spans(layout.rig).items():
            path, nominal = f"{self.part}.{field}", self._nominal(field)
            if isinstance(span, Span):
                yield self._gene(path, "real", span.grid(nominal))
            else:
                grid = Grid.choice(len(span), span.index(nominal))
                yield Gene(self.name, path, "category", grid, options=span)

    def nominally(self) -> str:
        return ", ".join(in_words(field, self._nominal(field)) for field, _ in self)

    def ranges(self) -> str:
        return ", ".join(
            f"{field} {span.low:g} to {amount(field, span.high)}"
            if isinstance(span, Span)
            else f"{field} {' or '.join(span)}"
            for field, span in self
        )

    @model_validator(mode="after")
    def _has_nominal(self) -> Self:
        for field, span in self:
            nominal = self._nominal(field)
            if not (span.holds(nominal) if isinstance(span, Span) else nominal in span):
                raise ValueError(f"{field} does not include {nominal}, its nominal value")
            if isinstance(nominal, int) and isinstance(span, Span) and span.step % 1:
                raise ValueError(f"{field} is a whole number, its step is {span.step:g}")
        return self

    def _nominal(self, field: str) -> Any:
        return getattr(model.EXTRAS[self.part], field)


class _InitialPose(Extra):
    def spans(self, rig: Rig) -> Mapping[str, Options]:
        return dict(list(self)[: rig.arm_joints])


class _InitialState(Extra):
    def genes(self, layout: Layout) -> Iterator[Gene]:
        if layout.rig.initial_states > 1:
            last = min(int(dict(self)["state"].high), layout.rig.initial_states - 1)
            yield self._gene(f"{self.part}.state", "category", Grid.choice(last + 1))


class _Bystander(Extra):
    """An operator of what stands in a task's own states and the task is not about, as offsets from there.

    A world that has such things makes the genes.
    """

    part = "targets"

    def genes(self, layout: Layout) -> Iterator[Gene]:
        yield from ()

    def _nominal(self, field: str) -> float:
        return 0.0


class BystanderPosition(_Bystander):
    """The offset of those things from their places in the task's own states."""

    name, says = "bystander-position", "where the task's own things stand that it is not about"
    x: Span
    y: Span


class BystanderOrientation(_Bystander):
    """The turn of those things from their orientation in the task's own states."""

    name, says = "bystander-orientation", "how the task's own things are turned that it is not about"
    yaw: Span


class EventOperator(Extra):
    """Something that happens in the middle of an episode: when, and how much; nominally it does not.

    Nothing is more severe in the moment or in the direction of an event, only in its size.
    """

    happens: ClassVar[str]  # what happens, in a clause that goes on with ``by`` and how much
    by: ClassVar[str]
    slot: ClassVar[int] = 0  # of the target that is concerned: a task with fewer has no such event
    own: ClassVar[bool] = False  # whether only tasks with initial states of their own have it

    def genes(self, layout: Layout) -> Iterator[Gene]:
        if self.slot < len(layout.of("targets")) and (layout.rig.initial_states > 1 or not self.own):
            for gene in super().genes(layout):
                if gene.path.endswith(".direction"):
                    yield replace(gene, kind="angle", grid=replace(gene.grid, wraps=True), neutral=True)
                elif gene.path.endswith(".intensity"):
                    yield replace(gene, grid=replace(gene.grid, log=True))
                elif gene.path.endswith((".rest", ".to", ".thing")):
                    yield replace(gene, drawn=1.0 if gene.path.endswith(".thing") else SELDOM)
                else:
                    yield replace(gene, neutral=gene.kind == "category")

    def nominally(self) -> str:
        return "never"


def _of_part(base: type[Kind], name: str, says: str, *, part: str = "", **about: object) -> type[Kind]:
    """The operator of a part of scenes: with a range for each number of the part, and options for each text."""
    part = part or name.replace("-", "_")
    nominal = model.EXTRAS[part]
    kinds: dict[str, Any] = get_type_hints(type(nominal))
    varied: dict[str, Any] = {}
    for field in fields(nominal):
        options = GenericAlias(tuple, (kinds[field.name], ...)), Field(strict=False, min_length=1)
        varied[field.name] = options if isinstance(field.default, str) else (Span, ...)
    operator = create_model(name, __base__=base, **varied)
    for key, value in {"name": name, "says": says, "part": part, **about}.items():
        setattr(operator, key, value)
    return operator


def _event(name: str, says: str, happens: str, by: str = "by", *, own: bool = False) -> type[EventOperator]:
    return _of_part(EventOperator, name, says, happens=happens, by=by, slot=int(name == "goal-slide"), own=own)


EVENT_KINDS = (
    _event("target-slide", "how far the target is slid in mid-episode", "the target slides away"),
    _event("goal-slide", "how far the second target is slid in mid-episode", "the second target slides away"),
    _event("camera-bump", "how far the camera is turned in mid-episode", "the camera is turned"),
    _event("light-switch", "a factor on all lights in mid-episode", "the light changes"),
    _event("picture-loss", "for how long the policy sees nothing new", "the pictures stop", "for"),
    _event("control-stall", "for how long the robot stands still in mid-episode", "the robot stands still", "for"),
    _event("grip-slip", "for how long the fingers open by themselves", "the fingers open", "for"),
    _event("target-topple", "whether the target falls over in mid-episode", "the target falls over"),
    _event("grip-weak", "a factor on the fingers' force in mid-episode", "the grip weakens"),
    _event("instruction-change", "what the instruction says from mid-episode on", "the instruction changes"),
    _event("newcomer", "which confounder is put down in mid-episode only", "{newcomer} is put down"),
    _event("target-knock", "whether the target is knocked over in mid-episode", "the target is knocked over", own=True),
    _event("target-switch", "which other thing the instruction names then", "the instruction changes", own=True),
)
EXTRA_KINDS: tuple[type[Extra], ...] = (
    _of_part(Extra, "backdrop", "what table and wall look like"),
    _of_part(_InitialPose, "initial-pose", "how the arm is bent at the start"),
    _of_part(Extra, "sensor-noise", "blur, noise and compression of images", part="noise"),
    _of_part(Extra, "control-latency", "how late actions are executed", part="latency"),
    _of_part(Extra, "exposure", "how far the cameras' exposure follows the light"),
    _of_part(_InitialState, "initial-state", "which of the task's own initial states it is", part="start"),
    BystanderPosition,
    BystanderOrientation,
    *EVENT_KINDS,
)
EXTRAS = frozenset(kind.name for kind in EXTRA_KINDS)
# `events` stands for all but the last three, which came later: random scenes are to stay what they are.
EVENTS = tuple(kind.name for kind in EVENT_KINDS[:-3])


def _again(name: str, ranges: dict[str, Any]) -> Extra:
    return next(kind for kind in EXTRA_KINDS if kind.name == name)(**ranges)
