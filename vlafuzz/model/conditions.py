"""Conditions: everything beside the scene that decides an outcome, each field declared once with its role."""

import hashlib
import json
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import MISSING, Field, asdict, dataclass, field, fields, replace
from enum import Enum
from typing import Any, Final, Generic, Self, TypeVar, cast
from urllib.parse import parse_qsl

from pydantic import BaseModel, TypeAdapter, ValidationError

from vlafuzz.common.reading import first_problem, plain
from vlafuzz.errors import UsageError, suggestion

ALONE = "alone-"  # begins labels that no other run has
CRITERIA = ("strict", "published")
# Settings that were fields before worlds declared theirs: keys have the first two whatever the world,
# and files have all of them among the fields.
_IN_KEYS: Mapping[str, Any] = {"placement": "resting", "min_distance": 0.0}
_AMONG_FIELDS: Mapping[str, Any] = {**_IN_KEYS, "visible": ""}
T = TypeVar("T")


@dataclass(frozen=True)
class Model:
    """A policy by its name, and the label that says which model answers under it; empty: nobody said."""

    policy: str
    label: str = ""

    def __str__(self) -> str:
        return f"{self.label} ({self.policy})" if self.label else self.policy

    @property
    def short(self) -> str:
        """The label with the address, but without options, which may be long."""
        return f"{self.label} ({self.address})" if self.label else self.policy

    @property
    def address(self) -> str:
        """Where it is asked: a server's address, a folder, or the name of another policy."""
        return self.policy.partition("?")[0]

    @property
    def which(self) -> str:
        """The name of the model: its label, or the ``version`` in the policy's name."""
        return self.label or dict(parse_qsl(self.policy.partition("?")[2])).get("version", "")

    def replaces(self, other: Self) -> bool:
        """Whether the two are asked at one address, but are different models: then one at a time can be."""
        return self.address == other.address and self.which != other.which


def check_label(flag: str, label: str | None) -> None:
    """Raise a UsageError for a label that does not fit into a line of text."""
    if label and not re.fullmatch(r"[\w.:@+/-]{1,100}", label):
        problem = f"{flag} {label!r}: expected up to 100 letters, digits and . : @ + / - _"
        raise UsageError(problem, hint=f"such as {flag} step-40000")


class Role(Enum):
    """What a field is part of."""

    SCENES = "which scenes a run proposes"
    POLICY = "what acts in them"
    SIMULATION = "where it acts, and what counts as success"
    PLACE = "what computes it: its last bits decide outcomes of single scenes, hardly shares of many"
    SEED = "the random numbers; runs that differ in nothing else are repetitions"
    SEARCH = "which of the scenes are tried, and how many"


class Origin(Enum):
    """Where a value comes from."""

    FLAG = "the user gives it as it is stored"
    FILE = "a file that the user names"
    HERE = "the code and the packages that are installed"


def condition(
    role: Role,
    origin: Origin,
    *,
    default: Any = MISSING,
    factory: Any = MISSING,
    compared_by: Callable[[Any], object] = lambda value: value,
    keyed_as: str | None = None,
    later: bool = False,
) -> Any:
    """A dataclass field of ``Conditions``.

    Args:
        compared_by: gives the part of the value that has to be equal.
        keyed_as: its name in keys, where that is another one than the field's.
        later: keys are older than the field, so they leave it out at its default. True for every new field.
    """
    about = {"role": role, "origin": origin, "by": compared_by, "keyed_as": keyed_as, "later": later}
    return field(default=default, default_factory=factory, metadata=about)


def _pool(scene_file: str) -> str | None:
    """Digest of the scenes from which a strategy chose; None where it made its own."""
    mark = json.loads(scene_file or "{}")
    return mark["digest"] if mark.get("flag") == "pool" else None


def _contents(packs: str) -> frozenset[tuple[str, str]]:
    """What packs are, wherever they lie."""
    return frozenset((mark["name"], mark["digest"]) for mark in json.loads(packs))


@dataclass(frozen=True)
class Setting(Generic[T]):
    """A condition that some worlds have, and declare; ``options``: all its values, where a user chooses one by name.

    ``served``: of pictures, the default for a policy behind a model server, whose answers take longer than a picture.
    """

    name: str
    default: T
    options: tuple[T, ...] = ()
    served: T | None = None

    def of(self, conditions: "Conditions") -> T:
        """Its value under these conditions."""
        return cast(T, conditions.world.get(self.name, self.default))


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Everything beside the scene that decides an outcome, or which scenes are tried.

    Attributes:
        policy: as the user named it; ``spec`` is its own description, as JSON.
        label: which model it is, where the policy's name does not say; see ``alone``.
        source: digest of the user's own code that makes the policy; empty for others.
        seed: of the rollouts; the n-th repeat of a scene has seed + n.
        repeats: rollouts a scene.
        criteria: ``strict``, or ``published`` of runs that are not rolled out any more. stop_early: whether a rollout
        ends at success instead of ten steps later.
        world: values of the world's own settings by name; what is missing has its default.
        place: where it runs, as JSON, see ``conditions.place``; empty if unknown.
        simulator: name and version of what the scenes are run in.
        commit: of vlafuzz's checkout, if it is one.
        operators: the operators with their ranges, as JSON; compared by ``operators_digest``. packs: of objects, as
        JSON: name, digest and folder; the catalogue's digest has their content, too. scene_file: the file of scenes
        that the run had or chose from, as JSON; empty for none.
    """

    task: str = condition(Role.SCENES, Origin.FLAG)
    robot: str = condition(Role.SCENES, Origin.FLAG, default="panda")
    policy: str = condition(Role.POLICY, Origin.FLAG, default="", keyed_as="subject")
    spec: str = condition(Role.POLICY, Origin.HERE, default="{}")
    source: str = condition(Role.POLICY, Origin.HERE, default="", later=True)
    label: str = condition(Role.POLICY, Origin.FLAG, default="", later=True)
    seed: int = condition(Role.SEED, Origin.FLAG, default=0)
    repeats: int = condition(Role.POLICY, Origin.FLAG, default=1)
    criteria: str = condition(Role.SIMULATION, Origin.HERE, default="strict")
    stop_early: bool = condition(Role.SIMULATION, Origin.FLAG, default=False)
    world: Mapping[str, str | float | bool] = condition(Role.SIMULATION, Origin.FILE, factory=dict)
    catalogue_digest: str = condition(Role.SIMULATION, Origin.HERE, default="")
    simulator: str = condition(Role.SIMULATION, Origin.HERE, default="")
    commit: str | None = condition(Role.SIMULATION, Origin.HERE, default=None)
    place: str = condition(Role.PLACE, Origin.HERE, default="", later=True)
    operators: str = "{}"
    operators_digest: str = condition(Role.SCENES, Origin.FILE, default="")
    packs: str = condition(Role.SCENES, Origin.FILE, default="[]", compared_by=_contents)
    scene_file: str = condition(Role.SCENES, Origin.FILE, default="", compared_by=_pool)

    def __post_init__(self) -> None:
        """Leave out settings at their defaults; raise a UsageError for criteria that no simulator knows."""
        check_choice("criteria", self.criteria, CRITERIA)
        known = {name: value for name, value in self.world.items() if value != _AMONG_FIELDS.get(name)}
        object.__setattr__(self, "world", known)

    @property
    def model(self) -> str:
        """The policy as people read it; runs that stand alone are told apart."""
        return f"{self.policy} ({self.label})" if self.alone else str(self.tested)

    @property
    def tested(self) -> Model:
        """The model that the policy is, as far as the user said."""
        return Model(self.policy, self.named)

    @property
    def short(self) -> str:
        """The policy where there is little room: the label, if any, in place of its name."""
        return self.named or self.policy

    @property
    def named(self) -> str:
        """The label that the user gave the policy; empty without one."""
        return "" if self.alone else self.label

    @property
    def alone(self) -> bool:
        """Whether nobody says which model the policy is, so that no other run may share its outcomes."""
        return self.label.startswith(ALONE)

    def values(self, *roles: Role) -> dict[str, object]:
        """The fields of some roles by their names in keys, and the settings of the world."""
        found = {
            declared.metadata["keyed_as"] or declared.name: getattr(self, declared.name)
            for declared in _declared(self)
            if declared.metadata["role"] in roles
            and not (declared.metadata["later"] and getattr(self, declared.name) == declared.default)
        }
        return found | {**_IN_KEYS, **found.pop("world")} if "world" in found else found

    def value(self, name: str) -> Any:
        """A field or a setting by its name; None for a setting that has its default."""
        known = {row.name for row in fields(self)}
        return getattr(self, name) if name in known else self.world.get(name, _AMONG_FIELDS.get(name))

    def without(self, setting: str) -> Self:
        """The same conditions with the default of a setting."""
        return replace(self, world={name: value for name, value in self.world.items() if name != setting})

    def key(self, *, seeded: bool = True) -> str:
        """The policy and all else that an outcome depends on: within one key, stored outcomes are reused."""
        roles = (Role.POLICY, Role.SIMULATION, Role.PLACE, *([Role.SEED] if seeded else []))
        text = json.dumps(self.values(*roles), sort_keys=True)
        return f"{self.policy}:{hashlib.blake2b(text.encode(), digest_size=6).hexdigest()}"

    def differences(
        self, other: Self, *, roles: Collection[Role] = tuple(Role), origins: Collection[Origin] = tuple(Origin)
    ) -> tuple[str, ...]:
        """Names of the fields and settings, of some roles and origins, in which others differ."""
        differing = [
            row.name
            for row in _declared(self)
            if row.metadata["role"] in roles
            and row.metadata["origin"] in origins
            and row.metadata["by"](getattr(self, row.name)) != row.metadata["by"](getattr(other, row.name))
        ]
        if "world" in differing:
            names = sorted({**self.world, **other.world})
            at = differing.index("world")
            differing[at : at + 1] = [name for name in names if self.value(name) != other.value(name)]
        return tuple(differing)

    def comparable(self, other: Self) -> bool:
        """Whether shares of failures may be compared: nothing but search, seed and place differs."""
        return not self.differences(other, roles=set(Role) - {Role.SEARCH, Role.SEED, Role.PLACE})

    @classmethod
    def flags(cls) -> tuple[str, ...]:
        """Names of the fields that hold what a flag of the same name gave."""
        return tuple(row.name for row in _declared(cls) if row.metadata["origin"] is Origin.FLAG)


def as_kept(conditions: Conditions) -> dict[str, Any]:
    """All fields as files keep them: some settings of worlds stand among them, ``world`` has the others."""
    kept = asdict(conditions)
    world = kept.pop("world")
    kept |= {name: world.pop(name, usual) for name, usual in _AMONG_FIELDS.items()}
    return kept | ({"world": world} if world else {})


def from_kept(kept: Mapping[str, Any]) -> dict[str, Any]:
    """The inverse of ``as_kept``."""
    among = {name: kept[name] for name in _AMONG_FIELDS if name in kept}
    others = {name: value for name, value in kept.items() if name not in among}
    return others | {"world": among | dict(others.get("world", {}))}


ASKED: Final = (Origin.FLAG, Origin.FILE)
"""Origins of what a user asks for; the rest comes with a version."""


def check_choice(name: str, value: str, known: Collection[str]) -> str:
    """The same value; a UsageError if it is not known."""
    if value not in known:
        raise UsageError(f"unknown {name} {value!r}", hint=suggestion(value, known))
    return value


def _declared(conditions: Conditions | type[Conditions]) -> list[Field[Any]]:
    return [declared for declared in fields(conditions) if "role" in declared.metadata]


class _Pack(BaseModel):
    name: str
    digest: str
    folder: str


class _SceneFile(BaseModel):
    flag: str
    file: str
    digest: str


class _Place(BaseModel):
    processor: str
    instructions: str
    torch: str


class _Spec(BaseModel):
    cameras: list[dict[str, Any]] = []


_KINDS: Mapping[str, TypeAdapter[Any]] = {
    "packs": TypeAdapter(list[_Pack]),
    "scene_file": TypeAdapter(_SceneFile),
    "place": TypeAdapter(_Place),
    "spec": TypeAdapter(_Spec),
    "operators": TypeAdapter(dict[str, Any]),
}


def check_read(conditions: Conditions) -> None:
    """Raise a ValueError if a text has unseen signs, or a field for JSON, unless it is empty, has none."""
    for text in (*vars(conditions).values(), *conditions.world, *conditions.world.values()):
        plain(text if isinstance(text, str) else "")
    for name, kind in _KINDS.items():
        try:
            if text := getattr(conditions, name):
                kind.validate_json(text)
        except ValidationError as error:
            raise ValueError(f"{name}: {first_problem(error)}") from None
