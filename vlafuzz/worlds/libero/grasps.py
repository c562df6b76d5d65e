"""Grasps for LIBERO's things, found on points of their surfaces: two fingers from above, at any yaw.

The hand's frame: x is the way in which the fingers close, z points down.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vlafuzz.common.arrays import Array
from vlafuzz.worlds.libero.env import LiberoEnv

POINTS = 3000  # of a thing's surface
NEIGHBOURS = 0.25  # metres from a thing within which other things are obstacles
PAD, THICK, REACH = 0.010, 0.020, 0.038  # half a finger's width, its thickness, half the open gap; metres
WIDEST = 0.068  # that is grasped, metres
PALM = np.array([0.11, 0.035])  # half its sizes
DEPTHS = (0.028, 0.02, 0.012)  # of the finger tips below a thing's top
TIP = 0.004  # metres below the hand's centre
CLEARANCE = 0.004  # of the tips above what a thing stands on
YAWS = np.radians([0, 15, -15, 30, -30, 45, -45, 60, -60, 75, -75, 90])


@dataclass(frozen=True, eq=False)
class Grasp:
    """A grasp: position of the hand's centre, metres, and its yaw from the robot's own, radians."""

    position: Array
    yaw: float


def find_grasps(env: LiberoEnv, name: str) -> list[Grasp]:
    """Grasps of a thing as it stands now, best first; empty if no finger fits."""
    own = surface(env, env.bodies[name], POINTS)
    around = obstacles(env, name)
    top, bottom, middle = own[:, 2].max(), own[:, 2].min(), own.mean(axis=0)
    rated: list[tuple[float, Grasp]] = []
    for yaw in YAWS:
        closing = np.array([-np.sin(yaw), np.cos(yaw)])  # the hand's x in the world, horizontally
        axes = np.stack([closing, np.array([closing[1], -closing[0]])], axis=1)
        mine, others = own[:, :2] @ axes, around[:, :2] @ axes
        for depth in DEPTHS:
            tip = max(top - depth, bottom + CLEARANCE)
            grid = _grid(mine[own[:, 2] > tip])
            good, offset = _fits(grid, mine[own[:, 2] > tip - 0.002], others, around[:, 2], tip, top)
            for centre in grid[good] + np.stack([offset[good], np.zeros(good.sum())], axis=1):
                place = axes @ centre
                away = float(np.linalg.norm(place - middle[:2]))
                score = away + 0.02 * abs(yaw) + 1.5 * (DEPTHS[0] - depth)
                rated.append((score, Grasp(np.array([*place, tip + TIP]), float(yaw))))
    return [grasp for _, grasp in sorted(rated, key=lambda pair: pair[0])]


def _grid(points: Array) -> Array:
    """``(n, 2)`` centres that are tried: a centimetre apart, over the points."""
    if not len(points):
        return np.zeros((0, 2))
    low, high = points.min(axis=0), points.max(axis=0)
    sides = [np.linspace(a, b, max(int((b - a) / 0.01), 2) + 1) for a, b in zip(low, high, strict=True)]
    middle = (low + high)[None] / 2
    return np.concatenate([middle, np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)])


def _fits(
    grid: Array, own: Array, others: Array, heights: Array, tip: float, top: float
) -> tuple[NDArray[np.bool_], Array]:
    """Which centres let the fingers close on something and touch nothing else; and its offset along x."""
    good, offset = np.zeros(len(grid), bool), np.zeros(len(grid))
    low = heights > tip - CLEARANCE / 2
    high = heights > tip + 0.03
    for index, centre in enumerate(grid):
        x, y = (own - centre).T
        between = x[(np.abs(y) < PAD) & (np.abs(x) < REACH)]
        if len(between) < 4 or np.ptp(between) > WIDEST:
            continue
        shift = float(between.max() + between.min()) / 2
        beside = np.abs(others[low] - centre - [shift, 0.0])
        x, y = np.abs(own - centre - [shift, 0.0]).T
        blocked = ((y < PAD + 0.003) & (x > REACH) & (x < REACH + THICK)).any()  # where the open fingers are
        if blocked or (beside < [REACH + THICK, PAD + 0.003]).all(axis=1).any():
            continue
        over = np.abs(others[high] - centre - [shift, 0.0])
        if top - tip > 0.03 or (over < PALM).all(axis=1).any():
            continue
        good[index], offset[index] = True, shift
    return good, offset


def obstacles(env: LiberoEnv, name: str) -> Array:
    """``(n, 3)`` points of everything near a thing but the robot, the thing itself and what is flat below."""
    place = env.place(name)
    parts = [surface(env, body, 8000) for other, body in env.bodies.items() if other != name]
    points = np.concatenate([np.zeros((0, 3)), *parts])
    return np.asarray(points[np.linalg.norm((points - place)[:, :2], axis=1) < NEIGHBOURS])


def surface(env: LiberoEnv, root: int, count: int) -> Array:
    """``(count, 3)`` points on the visible meshes and boxes of a body and its parts, in the world, metres."""
    model = env.model
    geoms = np.flatnonzero((model.body_rootid[model.geom_bodyid] == root) & (model.geom_group == 1))
    faces = [triangles(env, int(geom)) for geom in geoms]
    corners = np.concatenate([np.zeros((0, 3, 3)), *faces])
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(across, axis=1)
    random = np.random.default_rng(0)
    chosen = random.choice(len(corners), count, p=areas / areas.sum())
    shares = random.dirichlet([1.0, 1.0, 1.0], count)
    return np.asarray(np.einsum("nc,ncd->nd", shares, corners[chosen]))


def triangles(env: LiberoEnv, geom: int) -> Array:
    """``(n, 3, 3)`` of a mesh, or of the box about another shape, in the world."""
    model, data = env.model, env.data
    if (mesh := int(model.geom_dataid[geom])) >= 0:
        rows = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
        corners = model.mesh_vert[model.mesh_vertadr[mesh] + model.mesh_face[rows]].astype(np.float64)
    else:
        middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        corners = middle + half * _BOX
    return np.asarray(corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])


def _box() -> Array:
    """``(12, 3, 3)`` triangles of the box from -1 to 1."""
    found = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            square = np.insert(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float64), axis, side, axis=1)
            found += [square[[0, 1, 2]], square[[0, 2, 3]]]
    return np.stack(found)


_BOX = _box()
