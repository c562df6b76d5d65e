import numpy as np
import pytest
from scipy.spatial.distance import cdist

from vlafuzz.search.proposals import Archive


def filled(points: np.ndarray, capacity: int = 50) -> Archive:
    archive = Archive(capacity)
    for point in points:
        archive.add(point)
    return archive


def test_novelty_is_the_mean_distance_of_the_five_nearest():
    rng = np.random.default_rng(0)
    known, points = rng.random((40, 7)), rng.random((11, 7))
    nearest = np.sort(cdist(points, known))[:, :5]
    assert filled(known).novelty(points) == pytest.approx(nearest.mean(axis=1))


def test_a_point_is_not_its_own_neighbour():
    points = np.array([[0.0, 0.0], [3.0, 4.0]])
    assert filled(points).novelty(points) == pytest.approx([5.0, 5.0])
    assert filled(points[:1]).novelty(points[:1]) == pytest.approx([0.0])


def test_an_empty_archive_finds_nothing_novel():
    assert Archive().novelty(np.ones((3, 2))).tolist() == [0.0, 0.0, 0.0]


def test_only_the_last_points_are_kept():
    archive = filled(np.arange(10.0)[:, None], capacity=3)
    assert len(archive) == 3
    assert archive.novelty(np.array([[0.0]]), neighbours=1) == pytest.approx([7.0])
