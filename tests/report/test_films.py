from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.report.stores import MANIFEST
from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.rollouts.scene_runner import SimulatorSceneRunner
from vlafuzz.worlds.evaluator import FILM_SPEED, Film


@pytest.mark.render
def test_a_film_shows_the_scene_the_failure_and_what_the_witness_does(tmp_path: Path):
    runner = SimulatorSceneRunner(Path("a.db"), replace(MANIFEST, policy="frozen"))
    solved = runner.solve(nominal(), 0)
    films = [runner.film(nominal(), actions) for actions in (solved.rollouts[0].actions, None)]
    runner.close()
    solution, failure = (frames_of(film, tmp_path) for film in films if film is not None)
    assert [film.failed for film in films if film is not None] == [False, True]
    assert np.abs(failure[0] - failure[-1]).mean() < 2  # it never moves
    assert np.abs(solution[0] - solution[-1]).mean() > 3
    assert np.abs(failure[0] - solution[0]).mean() < 2  # the very same scene
    assert len(failure) > len(solution)


def frames_of(film: Film, folder: Path) -> np.ndarray:
    """Its frames, as numbers that can be subtracted."""
    (folder / "film.mp4").write_bytes(film.video)
    video = cv2.VideoCapture(str(folder / "film.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == 5 * FILM_SPEED
    frames = [frame for read, frame in iter(video.read, (False, None)) if read]
    video.release()
    assert cv2.imdecode(np.frombuffer(film.still, np.uint8), cv2.IMREAD_COLOR).shape == frames[0].shape
    return np.array(frames, dtype=float)
