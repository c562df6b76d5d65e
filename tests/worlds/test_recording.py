import cv2
import numpy as np

from vlafuzz.worlds.recording import to_mp4


def test_a_film_is_as_wide_as_its_pictures(tmp_path, capfd):
    (tmp_path / "f.mp4").write_bytes(to_mp4([np.zeros((224, 300, 3), np.uint8)] * 3, 6))
    assert cv2.VideoCapture(str(tmp_path / "f.mp4")).get(cv2.CAP_PROP_FRAME_WIDTH) == 300
    assert "WARNING" not in capfd.readouterr().err
