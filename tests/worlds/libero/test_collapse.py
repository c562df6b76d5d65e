"""Fewer triangles, with what a picture shows of a mesh as it was."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from vlafuzz.worlds.libero.collapse import Mesh, collapsed

SIDE = 24


def sheet(height=lambda x, y: 0.0 * x, seam: bool = False):
    """A square of one metre in triangles: positions, normals, textures by corner; two pieces with a seam."""
    line = np.linspace(0.0, 1.0, SIDE + 1)
    x, y = (part.reshape(-1) for part in np.meshgrid(line, line, indexing="ij"))
    points = np.stack([x, y, height(x, y)], axis=1)
    first = np.arange(SIDE * (SIDE + 1)).reshape(SIDE, SIDE + 1)[:, :-1].reshape(-1)
    right, up = first + SIDE + 1, first + 1
    triangles = np.concatenate([np.stack([first, right, up], 1), np.stack([right, right + 1, up], 1)])
    corners = points[triangles].astype(np.float32)
    normals = np.broadcast_to(np.float32([0, 0, 1]), corners.shape)
    textures = corners[..., :2].copy()
    if seam:  # the right half is elsewhere on the texture
        textures[corners[..., 0].mean(axis=1) > 0.5] += np.float32([5.0, 0.0])
    return corners, normals, textures


def only(parts, tolerance: float) -> Mesh:
    return next(collapsed(*parts, (tolerance,)))


def test_a_flat_sheet_needs_few_triangles_and_keeps_its_border():
    mesh = only(sheet(), 0.001)
    assert len(mesh.triangles) < 5 * SIDE  # all points of the border need 4 * SIDE - 2
    corners = mesh.points[mesh.triangles].astype(float)
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(1.0, abs=1e-3)


def test_a_hill_is_coarser_with_each_tolerance_and_no_farther_off():
    parts = sheet(lambda x, y: 0.2 * np.sin(3 * x) * np.sin(3 * y))
    meshes = list(collapsed(*parts, (0.001, 0.004, 0.02)))
    counts = [len(parts[0]), *(len(mesh.triangles) for mesh in meshes)]
    assert counts == sorted(counts, reverse=True)
    assert len(set(counts)) == 4
    for mesh, most in zip(meshes, (0.01, 0.03, 0.1), strict=True):
        middles = mesh.points[mesh.triangles].mean(axis=1)
        wanted = 0.2 * np.sin(3 * middles[:, 0]) * np.sin(3 * middles[:, 1])
        assert np.abs(middles[:, 2] - wanted).max() < most


def test_a_ridge_keeps_a_normal_for_each_side():
    positions, _, textures = sheet(lambda x, y: np.minimum(x, 1.0 - x))
    left = positions[..., 0].mean(axis=1, keepdims=True) < 0.5
    up = np.full(left.shape, np.sqrt(0.5))
    normals = np.stack([np.where(left, -up, up), 0 * up, up], axis=-1).repeat(3, axis=1)
    mesh = only((positions, normals, textures), 0.001)
    assert len(mesh.triangles) < 6 * SIDE
    middles = mesh.points[mesh.triangles].mean(axis=1)
    away = np.sign(middles[:, 0] - 0.5)[:, None]
    assert mesh.normals[mesh.triangles][..., 0] == pytest.approx(away * np.sqrt(0.5) * np.ones(3), abs=1e-6)


def test_what_remains_are_points_of_the_mesh_with_their_texture():
    parts = sheet(lambda x, y: 0.1 * x * y)
    mesh = only(parts, 0.005)
    both = np.concatenate([parts[0], parts[2]], axis=2).reshape(-1, 5)
    away, _ = cKDTree(both).query(np.concatenate([mesh.points, mesh.textures], axis=1))
    assert away.max() == 0.0


def test_a_seam_stays_closed_and_no_triangle_crosses_it():
    mesh = only(sheet(seam=True), 0.002)
    pieces = mesh.textures[mesh.triangles][..., 0] > 3
    assert (pieces.all(axis=1) | ~pieces.any(axis=1)).all()
    right = mesh.textures[:, 0] > 3
    edges = [set(map(tuple, mesh.points[side & np.isclose(mesh.points[:, 0], 0.5)])) for side in (right, ~right)]
    assert edges[0] == edges[1] != set()
