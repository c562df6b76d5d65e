"""What the renderer makes of the textures: the right way up, not mirrored, in the right colours."""

import numpy as np
import pytest
import sapien
import trimesh
from PIL import Image

from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.sim.rendering import use_shaders

pytestmark = pytest.mark.render
SIDE = 128


@pytest.fixture(scope="module")
def photograph():
    use_shaders()  # SAPIEN's are global: whatever ran before in this process
    scene = sapien.Scene([sapien.render.RenderSystem()])
    scene.set_ambient_light([1.0, 1.0, 1.0])
    camera = scene.add_camera("camera", SIDE, SIDE, np.radians(8), 0.05, 5.0)
    camera.entity.pose = sapien.Pose([1.0, 0, 0], [0, 0, 0, 1])  # in front of the object, which faces +x

    def shoot(name: str) -> np.ndarray:
        entity, visual = sapien.Entity(), sapien.render.RenderBodyComponent()
        visual.attach(sapien.render.RenderShapeTriangleMesh(str(load_catalogue()[name].visual)))
        entity.add_component(visual)
        scene.add_entity(entity)
        scene.update_render()
        camera.take_picture()
        scene.remove_entity(entity)
        return camera.get_picture("Color")[..., :3] / 255

    return shoot


def likeness(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


@pytest.mark.parametrize("name", ["coke_can", "7up_can", "sprite_can"])
def test_a_label_is_upright_and_not_mirrored(photograph, name):
    seen = photograph(name)[40:88, 50:78]
    (mesh,) = trimesh.load_scene(load_catalogue()[name].visual).geometry.values()
    label = mesh.visual.material.baseColorTexture.convert("RGB")
    width, height = label.size
    part = label.crop((int(width * 0.43), int(height * 0.29), int(width * 0.57), int(height * 0.71)))
    drawn = np.asarray(part.resize(seen.shape[1::-1], Image.Resampling.BOX)) / 255
    same = likeness(seen, drawn)
    assert same > 0.5
    assert same > likeness(seen, drawn[:, ::-1]) + 0.05
    assert same > likeness(seen, drawn[::-1]) + 0.05


def test_a_cube_shows_its_colour(photograph):
    seen = photograph("green_cube")[54:74, 54:74].mean(axis=(0, 1))
    colour = load_catalogue()["green_cube"].colour
    assert np.argmax(seen) == 1
    assert np.allclose(seen / seen.max(), colour / colour.max(), atol=0.15)
