"""Whether a person could see the targets in the first picture."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vlafuzz.model import Backdrop, Camera, InitialPose, Light, Noise, Placement, Scene
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.fairness.visible import skin, unseen
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.space import load_operators

CATALOGUE = load_catalogue()
BOUNDS = load_operators().visible
assert BOUNDS is not None
NOMINAL = Scene("pick-up", (Placement("apple", "resting", 0.0, 0.0),), "pick up apple")
SPOON = replace(NOMINAL, targets=(Placement("spoon", "lying", 0.0, 0.0),))


def reason(scene: Scene, **flags: bool) -> str:
    return unseen(scene, CATALOGUE, BOUNDS, **flags) or ""


def can(x: float, y: float) -> Placement:
    return Placement("coke_can", "standing", x, y)


@pytest.mark.parametrize("light", [0.05, 1.0, 20.0])
def test_an_apple_is_seen_by_the_light_of_the_default_range(light: float) -> None:
    assert reason(replace(NOMINAL, light=Light(light))) == ""


def test_darkness_hides_everything() -> None:
    dark = replace(NOMINAL, light=Light(0.0002))
    assert reason(dark).startswith("apple: ")
    assert reason(dark).endswith("/255 apart from the table under light × 0.0002; at least 8/255 is required")


def test_glare_hides_what_is_not_colourful() -> None:
    assert reason(SPOON) == ""
    assert "apart from the table under light × 20; " in reason(replace(SPOON, light=Light(20.0)))


def test_what_has_the_table_s_colour_is_hidden_by_it() -> None:
    eggplant = Placement("eggplant", "lying", 0.0, 0.0)
    black = replace(NOMINAL, targets=(eggplant,), light=Light(0.02), backdrop=Backdrop("plain", "black"))
    assert "apart from the table" in reason(black)
    assert reason(replace(black, backdrop=Backdrop("plain", "white"))) == ""


def test_an_object_behind_another_is_hidden_by_it() -> None:
    cube = Placement("green_cube", "flat", -0.1, 0.0)
    hidden = replace(NOMINAL, targets=(cube,), confounders=(can(-0.03, 0.0),))
    assert reason(hidden).startswith("green cube: coke can hides ")
    assert reason(replace(hidden, confounders=(can(-0.03, 0.1),))) == ""


def test_an_object_behind_the_hand_is_hidden_until_the_arm_is_turned_away() -> None:
    behind = replace(NOMINAL, targets=(can(-0.2, 0.0),), initial_pose=InitialPose(j2=8.0))
    assert reason(behind).startswith("coke can: the robot hides ")
    assert reason(replace(behind, initial_pose=InitialPose(j1=30.0, j2=8.0))) == ""


def test_an_object_outside_the_picture_is_not_seen() -> None:
    away = replace(NOMINAL, camera=Camera(yaw=60.0))
    assert reason(away) == "apple: only 0% of it is in the picture; at least 50% is required"


def test_a_tiny_object_is_not_seen() -> None:
    tiny = replace(NOMINAL, targets=(replace(NOMINAL.targets[0], scale=0.1),))
    assert reason(tiny).endswith("% of the picture; at least 0.030% is required")
    assert "it covers only 0.0" in reason(tiny)


def test_grain_needs_more_contrast() -> None:
    dim = replace(SPOON, light=Light(0.08))
    assert reason(dim) == ""
    assert reason(replace(dim, noise=Noise(grain=25.0))).endswith("; at least 25/255 is required")


def test_every_target_counts_and_no_confounder_does() -> None:
    bright = replace(SPOON, light=Light(20.0))
    apple, spoon = NOMINAL.targets[0], replace(SPOON.targets[0], y=0.2)
    assert reason(replace(bright, targets=(apple, spoon))).startswith("spoon: ")
    assert reason(replace(bright, targets=(apple,), confounders=(spoon,))) == ""


def test_outlines_have_flat_colours() -> None:
    bright = replace(SPOON, light=Light(4.0))
    assert reason(bright) == ""
    assert reason(bright, outlines=True).endswith(" under light × 4; at least 4/255 is required")


def test_it_is_checked_after_geometry_and_only_with_bounds() -> None:
    dark = replace(NOMINAL, light=Light(0.0002))
    rejection = check_static(dark, CATALOGUE, 0.15, BOUNDS)
    assert rejection is not None
    assert (rejection.check, rejection.reason) == ("unseen", reason(dark))
    assert check_static(dark, CATALOGUE, 0.15) is None
    off = replace(dark, targets=(replace(NOMINAL.targets[0], x=0.5),))
    rejection = check_static(off, CATALOGUE, 0.15, BOUNDS)
    assert rejection is not None
    assert rejection.check == "geometry"


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
