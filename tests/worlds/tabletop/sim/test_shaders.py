"""Our shaders: SAPIEN's, without what takes seconds to compute; and what they show."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sapien

from tests.worlds.tabletop.sim.scenes import nominal, pick_up, put
from vlafuzz.model import Camera, Scene
from vlafuzz.worlds.tabletop.sim import rendering
from vlafuzz.worlds.tabletop.sim.env import TabletopEnv

PLAIN = pick_up(put("green_cube", 0.1, 0.2))
LUMA = np.array([0.299, 0.587, 0.114])
EXTREMES = [
    Camera(),
    *(Camera(**{axis: angle}) for axis in ("roll", "pitch", "yaw") for angle in (-5.0, 5.0)),
    *(Camera(distance=0.05, azimuth=azimuth) for azimuth in (0.0, 90.0, 180.0, 270.0)),
    *(Camera(distance=0.05, elevation=elevation) for elevation in (-90.0, 90.0)),
    Camera(0.05, 0, -45, roll=5, pitch=5, yaw=5),  # beyond the table's near edge
]


@pytest.fixture
def own_cache(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path))
    return tmp_path


@pytest.fixture
def altered_sapien(tmp_path, monkeypatch) -> Path:
    """Its shaders, of which one adds mirrored light in other words."""
    folder = tmp_path / "sapien" / "vulkan_shader"
    for name in ("minimal", "common"):
        shutil.copytree(Path(sapien.__file__).parent / "vulkan_shader" / name, folder / name)
    shader = folder / "minimal" / "gbuffer.frag"
    shader.write_text(shader.read_text().replace("color += specularIBL(", "color = color + specularIBL("))
    monkeypatch.setattr(sapien, "__file__", str(folder.parent / "__init__.py"))
    return shader


def pack() -> Path:
    """Looked up anew."""
    return rendering._shader_pack.__wrapped__()


def picture(env: TabletopEnv, scene: Scene = PLAIN) -> np.ndarray:
    env.begin(scene)
    return env.picture("front")


def test_the_reflectance_table_is_gone(own_cache):
    stock = Path(sapien.__file__).parent / "vulkan_shader" / "minimal"
    ours = {file.name: file.read_text() for file in pack().iterdir()}
    assert own_cache in pack().parents
    assert set(ours) == {file.name for file in stock.iterdir()}
    assert not any("samplerBRDFLUT" in text for text in ours.values())
    assert any("samplerBRDFLUT" in file.read_text() for file in stock.iterdir())


def test_a_shader_that_is_not_as_expected_is_left_alone(own_cache, altered_sapien):
    assert (pack() / "gbuffer.frag").read_text() == altered_sapien.read_text()
    assert "samplerBRDFLUT" not in (pack() / "composite0.frag").read_text()


@pytest.mark.render
@pytest.mark.parametrize("camera", EXTREMES)
def test_there_is_something_behind_everything(seeing, camera):
    seen = picture(seeing, replace(PLAIN, camera=camera))
    assert (seen.max(axis=2) > 25).mean() > 0.999


def without(env: TabletopEnv, name: str) -> np.ndarray:
    """The picture of the same moment when one part of the room is not shown."""
    entity = next(entity for entity in env.world.scene.entities if entity.name == name)
    visual = entity.find_component_by_type(sapien.render.RenderBodyComponent)
    visual.visibility = 0.0
    seen = env.picture("front")
    visual.visibility = 1.0
    return seen


@pytest.mark.render
@pytest.mark.parametrize(
    ("part", "camera", "least"),
    [("table", EXTREMES[0], 0.6), ("wall", EXTREMES[0], 0.03), ("floor", EXTREMES[-1], 0.03)],
)
def test_the_room_is_in_the_picture(seeing, part, camera, least):
    seen = picture(seeing, replace(PLAIN, camera=camera)) @ LUMA
    assert (np.abs(without(seeing, part) @ LUMA - seen) > 4).mean() > least


@pytest.mark.render
@pytest.mark.parametrize("task", ["pick-up", "put-in"])
def test_nominal_light_is_neither_dark_nor_glaring(seeing, task):
    seen = picture(seeing, nominal(task))
    assert 80 < (seen @ LUMA).mean() < 160
    assert (seen.min(axis=2) > 250).mean() < 0.02  # burnt out


def test_the_tables_texture_has_its_average_colour_and_detail():
    texture = rendering._shaded(rendering.COLOUR, rendering.planks()).download()[..., :3] / 255.0
    assert texture.mean(axis=(0, 1)) == pytest.approx(rendering.COLOUR, abs=0.02)
    assert texture.std(axis=(0, 1)).min() > 0.01
    assert np.abs(np.diff(texture, axis=0)).mean() > 0.003
