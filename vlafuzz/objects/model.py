"""An object as everybody else sees it: solid parts, meshes on disc, rest poses and grasps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vlafuzz.errors import CatalogueError, suggestion

Array = NDArray[np.float64]
Role = Literal["graspable", "place", "obstacle", "marker"]


@dataclass(frozen=True, eq=False)
class Grasp:
    """A top-down grasp with two fingers, in the rest frame: yaw 0, origin at (0, 0), support plane z = 0.

    Attributes:
        yaw: direction of the closing axis from +x, degrees in [0, 180).
        width: between the fingers once they are closed on the object, metres.
        x: of the tool centre point (TCP), relative to the object's origin, metres.
        y: likewise.
        z: height of the TCP above the support plane, metres.
        quality: 0..1, higher is better.
    """

    yaw: float
    width: float
    x: float
    y: float
    z: float
    quality: float


@dataclass(frozen=True, eq=False)
class RestPose:
    """A way in which the object stays put on a level surface.

    Attributes:
        quaternion: ``(4,)`` w, x, y, z, at yaw 0.
        height: of the object's origin above the support, metres.
        top: the highest point above the support, metres.
        footprint: ``(k, 2)`` convex outline seen from above, counter-clockwise about the origin, metres.
        rolls: a push may make it roll away.
        grasps: best first; empty for places.
    """

    name: str
    quaternion: Array
    height: float
    top: float
    footprint: Array
    rolls: bool
    grasps: tuple[Grasp, ...]


@dataclass(frozen=True, eq=False)
class Container:
    """The room inside, centred on the object's origin in x and y; heights in the object's frame. Metres."""

    width: float
    depth: float
    floor: float
    rim: float


@dataclass(frozen=True, eq=False)
class Fit:
    """How a mesh that others made comes into the object's frame: scaled, then turned, then moved.

    Attributes:
        quaternion: ``(4,)`` w, x, y, z.
        position: ``(3,)`` metres.
    """

    scale: float
    quaternion: Array
    position: Array

    @cached_property
    def turn(self) -> Array:
        """Its rotation ``(3, 3)``."""
        return _matrix(self.quaternion)


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """One kind of object. The origin of its frame is the centre of its bounding box.

    Attributes:
        spoken: what an instruction calls it.
        colour: ``(3,)`` sRGB in 0..1, the one that dominates.
        mass: kilograms.
        friction: coefficient, static and dynamic alike; nothing bounces.
        density: mass over the summed volume of the parts, kilograms a cubic metre.
        parts: ``(n, 3)`` corners of each convex part, metres.
        vertices: ``(m, 3)`` corners of the hull of all, metres.
        role: an ``obstacle`` neither fits the gripper nor takes anything; a ``marker`` is a plane that stands
            for a place.
        visual: a ``.glb`` with textures; with ``fit`` any mesh.
        collision: one convex ``.obj`` a part.
        rests: the first is nominal.
        supports: other objects can be put on it.
        fit: of a pack's object; that of its mesh at its nominal size.
        box: ``(3,)`` the sides that its pack gives it, metres, turned as the mesh is by ``fit``, signs and
            all; None where none does.
    """

    name: str
    spoken: str
    role: Role
    mass: float
    friction: float
    colour: Array
    parts: tuple[Array, ...]
    vertices: Array
    visual: Path
    collision: tuple[Path, ...]
    rests: tuple[RestPose, ...]
    supports: bool
    container: Container | None
    density: float
    fit: Fit | None = None
    box: Array | None = None

    def turned(self, quaternion: Sequence[float]) -> Array:
        """The rotation ``(3, 3)`` of its frame for a raw quaternion, that of its mesh if it has one."""
        turn = _matrix(quaternion)
        return np.asarray(turn if self.fit is None else turn @ self.fit.turn.T)

    def shift(self, quaternion: Sequence[float]) -> Array:
        """``(3,)`` from the mesh's origin to that of the object, turned so. Metres, at its nominal size."""
        return np.zeros(3) if self.fit is None else -self.turned(quaternion) @ self.fit.position

    def scaled(self, scale: float) -> ObjectModel:
        """The same thing in another size, of the same stuff. Its grasps are left to whoever needs them."""
        return self if scale == 1.0 else _scaled(self, scale)

    def rest(self, name: str) -> RestPose:
        """The rest pose of that name.

        Raises:
            CatalogueError: it has none.
        """
        for rest in self.rests:
            if rest.name == name:
                return rest
        known = [rest.name for rest in self.rests]
        raise CatalogueError(
            f"{self.name}: no rest pose {name!r}, known: {', '.join(known)}", suggestion(name, known)
        )


def _matrix(quaternion: Sequence[float] | Array) -> Array:
    """The rotation ``(3, 3)`` of a quaternion w, x, y, z of any length."""
    w, x, y, z = np.asarray(quaternion) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@lru_cache(maxsize=128)
def _scaled(model: ObjectModel, scale: float) -> ObjectModel:
    room = model.container
    return replace(
        model,
        parts=tuple(part * scale for part in model.parts),
        vertices=model.vertices * scale,
        rests=tuple(
            replace(
                rest,
                height=rest.height * scale,
                top=rest.top * scale,
                footprint=rest.footprint * scale,
                grasps=(),
            )
            for rest in model.rests
        ),
        container=room
        and Container(room.width * scale, room.depth * scale, room.floor * scale, room.rim * scale),
        mass=model.mass * scale**3,
        box=None if model.box is None else model.box * scale,
    )
