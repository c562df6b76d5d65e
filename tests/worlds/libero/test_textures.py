import numpy as np
import pytest

from vlafuzz.worlds.libero.packages import load
from vlafuzz.worlds.libero.pictures import discard, shrink

pytestmark = pytest.mark.libero
MOST = 512
CHECKER = """<mujoco><asset>
  <texture name="large" type="2d" builtin="gradient" rgb1="1 0 0" rgb2="0 0 1" width="2048" height="1024"/>
  <texture name="small" type="2d" builtin="checker" rgb1="1 1 1" rgb2="0 0 0" width="64" height="64"/>
</asset></mujoco>"""


def test_a_large_texture_becomes_the_mean_of_its_pixels_and_a_small_one_stays():
    model = load("mujoco").MjModel.from_xml_string(CHECKER)
    large, small = (model.texture(name) for name in ("large", "small"))
    before = large.data.reshape(1024, 2048, 3).astype(float)
    kept = model.tex_data[model.tex_adr[small.id] :].copy()
    shrink(model)
    assert model.tex_width.tolist() == [MOST, 64]
    assert model.tex_height.tolist() == [MOST // 2, 64]
    start = model.tex_adr[large.id]
    after = model.tex_data[start : start + MOST * MOST // 2 * 3].reshape(MOST // 2, MOST, 3)
    expected = before.reshape(MOST // 2, 4, MOST, 4, 3).mean(axis=(1, 3))
    assert np.abs(after - expected).max() <= 1.0
    assert np.array_equal(model.tex_data[model.tex_adr[small.id] :], kept)


def test_what_is_given_back_is_these_pixels_and_nothing_beside_them():
    pixels = np.full(1 << 20, 7, np.uint8)
    inner = pixels[5000:-5000]
    discard(inner)
    assert (pixels[:5000] == 7).all()
    assert (pixels[-5000:] == 7).all()
    assert (inner == 0).mean() > 0.95
