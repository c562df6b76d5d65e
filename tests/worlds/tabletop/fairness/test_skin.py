"""Points on an object's surface stand for its looks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vlafuzz.worlds.tabletop.fairness.visible import skin
from vlafuzz.worlds.tabletop.objects import load_catalogue

CATALOGUE = load_catalogue()


@pytest.mark.parametrize("name", ["coke_can", "plate", "green_cube", "basket"])
def test_its_points_lie_on_the_object_with_normals_outwards(name: str) -> None:
    model, look = CATALOGUE[name], skin(CATALOGUE[name])
    low, high = model.vertices.min(axis=0) - 0.006, model.vertices.max(axis=0) + 0.006
    assert np.all((look.points >= low) & (look.points <= high))
    assert np.linalg.norm(look.normals, axis=1) == pytest.approx(1.0)
    outwards = look.points[:, 2] > 0.999 * high[2]
    assert np.all(look.normals[outwards, 2] > -0.1)


def test_it_has_the_colours_of_the_texture() -> None:
    red, white = np.array([0.7, 0.0, 0.0]), np.array([0.9, 0.9, 0.9])
    colours = skin(CATALOGUE["coke_can"]).colours
    for paint in (red, white):
        assert (np.abs(colours - paint).max(axis=1) < 0.1).sum() > 10


def test_a_mesh_of_a_pack_has_one_colour_that_is_srgb_if_it_comes_from_textures() -> None:
    model = CATALOGUE["apple"]
    plain = skin(replace(model, visual=Path("visual.dae")))
    textured = skin(replace(model, visual=Path("textured.dae")))
    assert np.all(plain.colours == model.colour)
    assert textured.colours[0] == pytest.approx(model.colour**2.2)
