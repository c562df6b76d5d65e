"""Fewer triangles: edges collapse where that moves the surface, its texture and its shading least.

One end of an edge moves into the other one, so that what remains keeps its position, normal and texture coordinates.
The error is a quadric (Garland and Heckbert, 1998) in a space of position, texture and normal. Seams, where a point has
several normals or texture coordinates, collapse along themselves, and never open.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.integer[Any]]
CREASE = 40.0  # degrees between normals that stay apart
SHADING = 0.01  # metres that count as much as a normal's turn by one radian
_SEAM = 10.0  # how much more a seam's way counts than the surface beside it
_FEWEST = 60  # triangles at which even a small mesh is left alone
_TURN = 0.3  # cosine of the turn at which a triangle counts as flipped


class Mesh(NamedTuple):
    """A mesh: points ``(n, 3)``, unit normals, texture coordinates ``(n, 2)``, and triangles ``(m, 3)`` of points."""

    points: Floats
    normals: Floats
    textures: Floats
    triangles: Ints


class _Quadrics(NamedTuple):
    """A quadric for each corner: the squared error at ``x`` is ``x @ square @ x + 2 * linear @ x + constant``."""

    square: Floats
    linear: Floats
    constant: Floats
    area: Floats

    def add(self, corners: Ints, square: Floats, through: Floats, area: Floats) -> None:
        """Add quadrics that are zero at a point each."""
        linear = -np.einsum("nij,nj->ni", square, through)
        np.add.at(self.square, corners, square)
        np.add.at(self.linear, corners, linear)
        np.add.at(self.constant, corners, -np.einsum("ni,ni->n", linear, through))
        np.add.at(self.area, corners, area)

    def errors(self, corners: Ints, places: Floats) -> Floats:
        error = np.einsum("ni,nij,nj->n", places, self.square[corners], places)
        error += 2 * np.einsum("ni,ni->n", self.linear[corners], places) + self.constant[corners]
        return np.asarray(np.maximum(error, 0.0))


class _Edges(NamedTuple):
    """Directed edges by the points at their ends; the corners ``(r, 2)`` that meet along edge ``of`` each."""

    start: Ints
    end: Ints
    faces: Ints
    corners: Ints
    of: Ints


def collapsed(positions: Floats, normals: Floats, textures: Floats, tolerances: Sequence[float]) -> Iterator[Mesh]:
    """The same mesh with ever fewer triangles, one for each tolerance.

    Args:
        positions, normals: ``(n, 3, 3)`` of each triangle's corners; ``textures``: ``(n, 3, 2)``, or zeros. tolerances:
        rising root mean squares by which the surface around a point may move, metres.
    """
    at, mesh, owner = _welded(positions, normals, textures)
    places = np.concatenate([mesh.points, _scaled(mesh), SHADING * mesh.normals], axis=1).astype(np.float64)
    triangles = mesh.triangles[_solid(owner[mesh.triangles])]
    quadrics = _quadrics(places, triangles)
    for tolerance in tolerances:
        while len(triangles) > _FEWEST:
            table = _round(at, owner, places, quadrics, triangles, tolerance)
            if table is None:
                break
            triangles = table[triangles]
            triangles = triangles[_solid(owner[triangles])]
        used, numbers = np.unique(triangles, return_inverse=True)
        points, normals, textures = (
            part[used].astype(np.float32) for part in (mesh.points, mesh.normals, mesh.textures)
        )
        yield Mesh(points, normals, textures, numbers.reshape(-1, 3).astype(np.uint32))


def _welded(positions: Floats, normals: Floats, textures: Floats) -> tuple[Floats, Mesh, Ints]:
    """All points, a mesh whose corners are shared where they are alike, and the point of each corner."""
    points, at = np.unique(positions.reshape(-1, 3), axis=0, return_inverse=True)
    at = at.reshape(-1)
    alike = np.concatenate([at[:, None], textures.reshape(-1, 2)], axis=1)
    _, groups = np.unique(alike, axis=0, return_inverse=True)
    label = _smoothed(groups.reshape(-1), normals.reshape(-1, 3))
    sums: Floats = np.stack([np.bincount(label, part) for part in normals.reshape(-1, 3).T], axis=1)
    first = np.unique(label, return_index=True)[1]
    owner = at[first]
    mesh = Mesh(points[owner], _unit(sums), textures.reshape(-1, 2)[first], label.reshape(-1, 3))
    return points, mesh, owner


def _smoothed(groups: Ints, normals: Floats) -> Ints:
    """Numbers of corners, from 0; those of a group share one if their normals are within ``CREASE``."""
    label, left, count = np.full(len(groups), -1), np.arange(len(groups)), 0
    while len(left):
        seeds, first, index = np.unique(groups[left], return_index=True, return_inverse=True)
        near = np.einsum("ni,ni->n", normals[left[first]][index], normals[left]) > np.cos(np.radians(CREASE))
        near[first] = True
        label[left[near]] = count + index[near]
        left, count = left[~near], count + len(seeds)
    return np.unique(label, return_inverse=True)[1].reshape(-1)


def _scaled(mesh: Mesh) -> Floats:
    """Convert texture coordinates to metres, by the areas of texture and surface."""
    sides = np.diff(mesh.textures[mesh.triangles], axis=1)
    flat = np.abs(np.linalg.det(sides)).sum()
    solid = np.linalg.norm(_across(mesh.points[mesh.triangles]), axis=1).sum()
    return np.asarray(mesh.textures * (np.sqrt(solid / flat) if flat > 0 else 0.0))


def _across(triangles: Floats) -> Floats:
    """The normals of triangles, ``(n, 3, 3)`` corners, as long as twice the area."""
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def _unit(ways: Floats) -> Floats:
    return np.asarray(ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-12))


def _solid(triangles: Ints) -> NDArray[np.bool_]:
    return np.asarray((np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1))


def _quadrics(places: Floats, triangles: Ints) -> _Quadrics:
    """Distances from the planes of the triangles, and at seams and borders from planes upright on them."""
    count, space = places.shape
    quadrics = _Quadrics(np.zeros((count, space, space)), np.zeros((count, space)), np.zeros(count), np.zeros(count))
    first, second, third = (places[triangles[:, k]] for k in range(3))
    across = _across(places[triangles][..., :3])
    area = 0.5 * np.linalg.norm(across, axis=1)
    along = _unit(second - first)
    beside = _unit((third - first) - np.einsum("ni,ni->n", third - first, along)[:, None] * along)
    square = np.eye(space) - along[:, :, None] * along[:, None] - beside[:, :, None] * beside[:, None]
    for corner in triangles.T:
        quadrics.add(corner, square * area[:, None, None], first, area)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    _, index, times = _different(np.sort(edges, axis=1), count)
    alone = times[index] == 1
    start, end = edges[alone].T
    way = places[end, :3] - places[start, :3]
    upright = _unit(np.cross(way, _unit(across)[np.tile(np.arange(len(triangles)), 3)[alone]]))
    square = np.zeros((len(start), space, space))
    weight = _SEAM * np.einsum("ni,ni->n", way, way)
    square[:, :3, :3] = upright[:, :, None] * upright[:, None] * weight[:, None, None]
    for corner in (start, end):
        quadrics.add(corner, square, places[start], np.zeros(len(start)))
    return quadrics


def _round(
    points: Floats, owner: Ints, places: Floats, quadrics: _Quadrics, triangles: Ints, tolerance: float
) -> Ints | None:
    """Collapse the cheaper half of edges where they do not touch: a new corner for each, None at the end."""
    edges = _edges(owner, triangles)
    errors = quadrics.errors(edges.corners[:, 0], places[edges.corners[:, 1]])
    error = np.bincount(edges.of, errors)
    area = np.bincount(edges.of, quadrics.area[edges.corners[:, 0]])
    error = np.where(_allowed(edges, owner, triangles), error / np.maximum(area, 1e-12), np.inf)
    order = np.lexsort((error, edges.start))
    best = order[np.unique(edges.start[order], return_index=True)[1]]
    best = best[error[best] < tolerance**2]
    best = best[~_flips(points, owner[triangles], edges, best)]
    if not len(best):
        return None
    best = best[np.argsort(error[best], kind="stable")][: (len(best) + 1) // 2]
    rank = np.full(len(points), len(points))
    rank[edges.start[best]] = np.arange(len(best))
    least = rank[owner[triangles]].min(axis=1)
    beaten = np.zeros(len(points), bool)
    for corner in owner[triangles].T:
        beaten[corner[least < rank[corner]]] = True
    chosen = np.zeros(len(edges.start), bool)
    chosen[best] = ~beaten[edges.start[best]]
    old, new = edges.corners[chosen[edges.of]].T
    for part in quadrics:
        np.add.at(part, new, part[old])
    table = np.arange(len(places))
    table[old] = new
    return table


def _edges(owner: Ints, triangles: Ints) -> _Edges:
    pairs = ((0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2))
    corners = np.concatenate([triangles[:, pair] for pair in pairs])
    corners, _, times = _different(corners, len(owner))
    ends, of, _ = _different(owner[corners], len(owner))
    return _Edges(ends[:, 0], ends[:, 1], np.bincount(of, times), corners, of)


def _different(pairs: Ints, count: int) -> tuple[Ints, Ints, Ints]:
    """The distinct pairs of ``(n, 2)`` numbers below ``count``, the index of each given pair, and their counts."""
    codes = pairs[:, 0].astype(np.int64) * count + pairs[:, 1]
    codes, index, times = np.unique(codes, return_inverse=True, return_counts=True)
    return np.stack(np.divmod(codes, count), axis=1), index, times


def _allowed(edges: _Edges, owner: Ints, triangles: Ints) -> NDArray[np.bool_]:
    """Whether each corner of the start goes into exactly one of the end, and borders stay borders."""
    count = int(owner.max()) + 1
    corners = np.bincount(owner[np.unique(triangles)], minlength=count)[edges.start]
    first = _different(np.stack([edges.of, edges.corners[:, 0]], axis=1), len(owner))[0][:, 0]
    clear = (np.bincount(edges.of) == corners) & (np.bincount(first) == corners)
    border = np.zeros(count, bool)
    border[edges.start[edges.faces == 1]] = True
    return np.asarray(clear & (edges.faces <= 2) & (~border[edges.start] | (edges.faces == 1)))


def _flips(points: Floats, triangles: Ints, edges: _Edges, best: Ints) -> NDArray[np.bool_]:
    """Whether each collapse would turn a triangle over. ``triangles``: by their points."""
    target, flips = np.full(len(points), -1), np.zeros(len(points), bool)
    target[edges.start[best]] = edges.end[best]
    corners = points[triangles]
    before = _unit(_across(corners))
    for k in range(3):
        new = target[triangles[:, k]]
        stays = (new >= 0) & ~(triangles == new[:, None]).any(axis=1)
        after = corners[stays].copy()
        after[:, k] = points[new[stays]]
        turned = np.einsum("ni,ni->n", before[stays], _unit(_across(after))) < _TURN
        flips[triangles[stays, k][turned]] = True
    return flips[edges.start[best]]
