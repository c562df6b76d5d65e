"""ObjectModel, the interface of a built object: convex parts, mesh files, stable poses and grasps."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PlainSerializer, PlainValidator

from vlafuzz.errors import CatalogueError, suggestion
from vlafuzz.worlds.manipulation.rotations import rotation_matrix


def _read_only(values: object) -> NDArray[np.float64]:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False  # models are shared
    return array


# As lists of numbers in JSON
Array = Annotated[NDArray[np.float64], PlainValidator(_read_only), PlainSerializer(np.ndarray.tolist)]
ROUGH = 0.7  # roughness where a pack does not say it
SRGB = 2.2  # exponent from sRGB to linear, as SAPIEN has it
# An obstacle neither fits the gripper nor holds anything; a marker is a plane that stands for a place.
Role = Literal["graspable", "place", "obstacle", "marker"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Grasp:
    """A top-down two-finger grasp of an object in a stable pose at (0, 0), with yaw 0, on the plane z = 0."""

    yaw: float  # direction of the closing axis from +x, degrees in [0, 180)
    width: float  # between the fingers closed on the object, metres
    x: float  # of the tool centre point (TCP) relative to the object's origin, metres
    y: float
    z: float  # height of the TCP above the support plane, metres
    quality: float  # in [0, 1], higher is better


@dataclass(frozen=True, eq=False, kw_only=True)
class StablePose:
    """An orientation in which the object stays put on a level surface. Metres."""

    name: str
    quaternion: Array  # (4,) w, x, y, z, at yaw 0
    height: float  # of the object's origin above the support
    top: float  # height of the highest point above the support
    footprint: Array  # (k, 2) convex outline seen from above, counter-clockwise about the origin
    rolls: bool  # whether a push can make the object roll away
    grasps: tuple[Grasp, ...]  # best first; empty for places


@dataclass(frozen=True, eq=False)
class Container:
    """A cavity, centred on the object's origin in x and y; heights in the object's frame. Metres."""

    width: float
    depth: float
    floor: float
    rim: float


@dataclass(frozen=True, eq=False)
class Fit:
    """The transform from a pack's mesh into the object's frame: scale, then rotate, then move by metres."""

    scale: float
    quaternion: Array
    position: Array

    @cached_property
    def turn(self) -> Array:
        return _rotation(self.quaternion)


@dataclass(frozen=True, eq=False, kw_only=True)
class ObjectModel:
    """One kind of object. The origin of its frame is the centre of its bounding box. Metres, kilograms."""

    name: str
    spoken: str  # what an instruction calls it
    role: Role
    mass: float
    friction: float  # static and dynamic; the restitution is zero
    colour: Array  # (3,) dominant colour, sRGB in [0, 1]
    parts: tuple[Array, ...]  # (n, 3) corners of each convex part
    vertices: Array  # (m, 3) corners of the convex hull of all parts
    visual: Path  # a .glb with textures; any mesh format if ``fit`` is set
    collision: tuple[Path, ...]  # one convex .obj per part
    # The first is nominal; the alias is the key in files of all versions
    stable_poses: Annotated[tuple[StablePose, ...], Field(alias="rests")]
    supports: bool  # whether other objects can be put on it
    container: Container | None
    density: float  # of the parts
    fit: Fit | None = None  # for objects of packs, the transform of the mesh at its nominal size

    def turned(self, quaternion: Sequence[float]) -> Array:
        """The object frame's rotation ``(3, 3)`` given a raw quaternion of the mesh."""
        turn = _rotation(quaternion)
        return np.asarray(turn if self.fit is None else turn @ self.fit.turn.T)

    def shift(self, quaternion: Sequence[float]) -> Array:
        """``(3,)`` from the mesh's origin to the object's at this orientation and nominal size, metres."""
        return np.zeros(3) if self.fit is None else -self.turned(quaternion) @ self.fit.position

    def scaled(self, scale: float) -> "ObjectModel":
        """The same object in another size, of the same density, without grasps."""
        return self if scale == 1.0 else _scaled(self, scale)

    def stable_pose(self, name: str) -> StablePose:
        """The stable pose of that name; a CatalogueError if there is none."""
        for pose in self.stable_poses:
            if pose.name == name:
                return pose
        known = [pose.name for pose in self.stable_poses]
        problem = f"{self.name}: no rest pose {name!r}, known: {', '.join(known)}"
        raise CatalogueError(problem, suggestion(name, known))


def _rotation(quaternion: Sequence[float] | Array) -> Array:
    """The rotation ``(3, 3)`` of a quaternion w, x, y, z of any norm."""
    return np.array(rotation_matrix(np.asarray(quaternion) / np.linalg.norm(quaternion)))


@lru_cache(maxsize=128)
def _scaled(model: ObjectModel, scale: float) -> ObjectModel:
    cavity = model.container
    poses = tuple(
        replace(pose, height=pose.height * scale, top=pose.top * scale, footprint=pose.footprint * scale, grasps=())
        for pose in model.stable_poses
    )
    return replace(
        model,
        parts=tuple(part * scale for part in model.parts),
        vertices=model.vertices * scale,
        stable_poses=poses,
        container=cavity and Container(*(length * scale for length in astuple(cavity))),
        mass=model.mass * scale**3,
    )
