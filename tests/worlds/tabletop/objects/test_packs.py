"""Packs: what is made of objects in a user's folder."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.doubles import manifest
from tests.packs import box, can, write_pack
from vlafuzz.common import assets
from vlafuzz.errors import CatalogueError, UsageError
from vlafuzz.model import Placement
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.fairness.footprint import solid
from vlafuzz.worlds.tabletop.objects import Catalogue, ObjectModel, load_catalogue, open_packs
from vlafuzz.worlds.tabletop.objects.catalogue import packs_json, stored_catalogue
from vlafuzz.worlds.tabletop.objects.packs import packs_of, spoken
from vlafuzz.worlds.tabletop.sim.world import World
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators

STICK = box(0.03, 0.03, 0.08)


@pytest.fixture(autouse=True)
def nothing_else_is_known(monkeypatch):
    monkeypatch.delenv("VLAFUZZ_PACKS", raising=False)


def catalogue(*folders: Path) -> Catalogue:
    return load_catalogue(packs=[pack for folder in folders for pack in open_packs(str(folder))])


def only(folder: Path, info: str = "info_mine.json", /, **objects: trimesh.Trimesh) -> ObjectModel:
    write_pack(folder / "mine", info, **objects)
    (name,) = objects
    return catalogue(folder / "mine")[f"mine:{name}"]


def size(model: ObjectModel) -> list[float]:
    return [round(float(side), 4) for side in np.ptp(model.vertices, axis=0)]


def test_what_only_tells_meshes_apart_is_not_spoken():
    names = ("bridge_carrot_generated_modified", "green_cube_3cm", "baked_opened_redbull_can_v2", "generated")
    assert [spoken(name) for name in names] == ["carrot", "green cube", "redbull can", "generated"]


def test_size_and_mass_are_those_of_the_mesh_whatever_the_info_says(tmp_path):
    model = only(tmp_path, brick=box(0.04, 0.06, 0.1, at=(0.3, 0, 0)))
    assert model.name == catalogue(tmp_path / "mine").names()[-1] == "mine:brick"
    half = model.scaled(0.5)
    assert (half.mass, half.density) == pytest.approx((model.mass / 8, model.density), rel=1e-4)
    assert size(model) == [0.04, 0.06, 0.1]
    assert np.allclose(model.vertices.min(axis=0) + model.vertices.max(axis=0), 0)
    assert model.mass == pytest.approx(0.04 * 0.06 * 0.1 * 500)


def test_rest_poses_are_measured_with_what_the_gripper_can_take_in_each(tmp_path):
    model = only(tmp_path, brick=box(0.04, 0.06, 0.1))
    tops = {pose.name: round(pose.top, 3) for pose in model.stable_poses}
    assert tops == {"upright": 0.1, "lying": 0.04, "lying_2": 0.06}
    assert {pose.grasps[0].width for pose in model.stable_poses} == {0.04, 0.06}
    assert model.role == "graspable"


def test_a_can_of_simplers_stands_along_y_and_rolls_when_it_lies(tmp_path):
    model = only(tmp_path, "info_pick_custom_v0.json", cola_can=can())
    assert size(model) == pytest.approx([0.06, 0.06, 0.12], abs=1e-3)
    assert [(pose.name, pose.rolls) for pose in model.stable_poses] == [("upright", False), ("lying", True)]


def test_the_largest_scale_is_the_real_size(tmp_path):
    folder = write_pack(tmp_path / "mine", brick=box(0.4, 0.6, 1.0))
    (folder / "info_mine.json").write_text(json.dumps({"brick": {"scales": [0.05]}}))
    (folder / "info_put.json").write_text(json.dumps({"brick": {"scales": [0.1]}}))
    assert size(catalogue(folder)["mine:brick"]) == [0.04, 0.06, 0.1]


def test_each_connected_part_is_convex_for_itself(tmp_path):
    both = trimesh.util.concatenate([box(0.02, 0.06, 0.02), box(0.02, 0.06, 0.02, at=(0.04, 0, 0))])
    assert [len(part) for part in only(tmp_path, rails=both).parts] == [8, 8]


def test_a_fine_mesh_becomes_a_lean_one_of_the_same_size(tmp_path):
    model = only(tmp_path, ball=trimesh.creation.icosphere(subdivisions=4, radius=0.03))
    assert len(model.vertices) <= 64
    assert size(model) == pytest.approx([0.06, 0.06, 0.06], abs=2e-3)


def test_others_are_put_onto_plates_and_cloths_and_into_ycbs_bowl(tmp_path):
    objects = catalogue(write_pack(tmp_path / "ycb", bridge_plate=box(0.1, 0.1, 0.006), bowl=box(0.15, 0.15, 0.05)))
    assert (objects["ycb:bridge_plate"].role, objects["ycb:bridge_plate"].supports) == ("place", True)
    assert (objects["ycb:bowl"].role, objects["ycb:bowl"].container.width) == ("place", 0.072)


def test_what_the_gripper_cannot_take_is_an_obstacle_which_may_stand_about(tmp_path):
    folder = write_pack(tmp_path / "mine", block=box(0.1, 0.1, 0.1), crate=box(0.03, 0.2, 0.2))
    os.replace(folder / "models" / "crate", folder / "models" / "slab")
    (folder / "info_mine.json").write_text(json.dumps({"block": {}, "slab": {"density": 5000}}))
    objects = catalogue(folder)
    assert [objects[f"mine:{name}"].role for name in ("block", "slab")] == ["obstacle", "place"]
    assert objects.names("obstacle")[-1] == "mine:block"


def test_without_looks_it_shows_its_solid_in_one_colour(tmp_path):
    model = only(tmp_path, green_cube=box(0.03, 0.03, 0.03, at=(0.2, 0.0, 0.0)))
    (drawn,) = trimesh.load(model.visual).geometry.values()
    assert np.allclose(drawn.extents, 0.03)
    assert np.allclose(drawn.bounds.mean(axis=0) + model.fit.position, 0.0)  # drawn in its mesh's frame
    assert np.argmax(model.colour) == 1


def test_looks_stay_in_the_pack_and_are_fitted_to_the_solid(tmp_path):
    folder = write_pack(tmp_path / "mine", "info_custom.json", cola_can=can().apply_translation([0, 1, 0]))
    looks = folder / "models" / "cola_can" / "textured.glb"
    can().apply_translation([0, 1, 0]).export(looks)
    model = catalogue(folder)["mine:cola_can"]
    assert model.visual == looks
    assert model.fit is not None
    turn = trimesh.transformations.quaternion_matrix(model.fit.quaternion)[:3, :3]
    shown = trimesh.load_mesh(looks).vertices @ turn.T * model.fit.scale + model.fit.position
    assert np.allclose(np.ptp(shown, axis=0), np.ptp(model.vertices, axis=0), atol=1e-3)
    assert np.allclose(shown.min(axis=0), model.vertices.min(axis=0), atol=1e-3)


def test_a_raw_quaternion_is_that_of_the_mesh(tmp_path):
    """A can along y, whose mesh's origin is 0.05 m off its middle, a quarter turn about x."""
    model = only(tmp_path, "info_custom.json", cola_can=can().apply_translation([0.05, 0.0, 0.0]))
    upright = Placement("mine:cola_can", "", 0.1, 0.2, quaternion=(0.5**0.5, 0.5**0.5, 0.0, 0.0), scale=0.5)
    points = solid(upright, model)
    assert np.allclose(np.ptp(points, axis=0), [0.03, 0.03, 0.06], atol=1e-3)
    assert np.allclose(points[:, :2].min(axis=0) + 0.015, [0.125, 0.2], atol=1e-3)
    pose = World.place(model.scaled(0.5), upright)
    assert pose.p == pytest.approx([0.125, 0.2, 0.03], abs=1e-3)
    assert abs(pose.q[0]) == pytest.approx(1.0)  # as it is built: z is up


def test_a_plane_that_marks_a_place_is_no_object_that_scenes_are_made_of(tmp_path):
    folder = write_pack(tmp_path / "mine", dummy_sink_target_plane=box(0.13, 0.08, 0.002), stick=STICK)
    objects = catalogue(folder)
    marker = objects["mine:dummy_sink_target_plane"]
    assert (marker.role, marker.spoken) == ("marker", "yellow basket")
    assert (marker.container.width, marker.container.depth) == (0.13, 0.08)
    slots = SearchSpace(load_operators(), objects, "put-in").composer.layout.slots
    assert slots["targets.1"] == ("basket",)
    assert all("mine:dummy_sink_target_plane" not in names for names in slots.values())


def test_the_digest_is_of_the_content_and_not_of_the_place(tmp_path):
    first = write_pack(tmp_path / "mine", brick=box(0.04, 0.06, 0.1))
    before = catalogue(first).digest
    shutil.move(first, tmp_path / "elsewhere")
    second = tmp_path / "elsewhere"
    assert catalogue(second.rename(tmp_path / "mine")).digest == before != load_catalogue().digest
    box(0.04, 0.06, 0.11).export(first / "models" / "brick" / "collision.obj")
    assert catalogue(first).digest != before


def test_a_folder_of_packs_has_them_all_and_two_of_one_name_exclude_each_other(tmp_path):
    for name in ("one", "two"):
        write_pack(tmp_path / "assets" / name, cube=box(0.03, 0.03, 0.03))
    assert [pack.name for pack in open_packs(str(tmp_path / "assets"))] == ["one", "two"]
    again = write_pack(tmp_path / "other" / "one", cube=box(0.03, 0.03, 0.03))
    with pytest.raises(CatalogueError, match="both packs are named 'one'"):
        catalogue(tmp_path / "assets", again)


def test_what_is_no_pack_is_said_in_a_sentence(tmp_path):
    with pytest.raises(UsageError, match="neither a pack of objects nor a folder of packs") as caught:
        open_packs(str(tmp_path))
    assert "info_*.json and models/NAME/collision.obj" in str(caught.value.hint)
    with pytest.raises(UsageError, match="nowhere: no such folder"):
        open_packs("nowhere")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[", "info_mine.json: "),
        ('{"brick": {"scales": []}}', "brick.scales: "),
        ('{"brick": {"density": -1}}', "brick.density: "),
        ('{"other": {}}', "a pack without objects"),
    ],
)
def test_a_wrong_info_file_is_named_with_its_key(tmp_path, text, message):
    folder = write_pack(tmp_path / "mine", brick=box(0.04, 0.06, 0.1))
    (folder / "info_mine.json").write_text(text)
    with pytest.raises(UsageError) as caught:
        open_packs(str(folder))
    assert message in caught.value.message
    assert "\n" not in caught.value.message


def test_names_tell_which_packs_scenes_need(tmp_path, monkeypatch):
    write_pack(tmp_path / "mine", brick=box(0.04, 0.06, 0.1))
    assert packs_of(["apple"]) == ()
    with pytest.raises(UsageError, match="objects of the pack 'mine', which is not here"):
        packs_of(["mine:brick"])
    monkeypatch.setenv("VLAFUZZ_PACKS", str(tmp_path))
    assert [pack.name for pack in packs_of(["mine:brick", "apple"])] == ["mine"]


def test_scenes_are_made_of_the_packs_objects_as_far_as_they_go(tmp_path):
    sticks = {f"stick_{letter}": box(0.03, 0.03, 0.08) for letter in "abcde"}
    space = SearchSpace(load_operators(), catalogue(write_pack(tmp_path / "mine", **sticks)), "put-in")
    slots = space.composer.layout.slots
    assert set(slots["targets.0"]) == set(slots["confounders.0"]) == {f"mine:{name}" for name in sticks}
    assert slots["targets.1"] == ("basket",)  # the pack has none
    scene = space.sample(np.random.default_rng(1))
    assert check_static(scene, space.catalogue, 0.15) is None


def test_robots_that_lie_beside_a_stores_packs_are_found_again(tmp_path, monkeypatch):
    monkeypatch.setenv(assets.FOLDERS, "")
    (tmp_path / "robots").mkdir()
    packs = open_packs(str(write_pack(tmp_path / "mine", can=can())))
    assert assets.find("robots") is None
    found = stored_catalogue(manifest(packs=packs_json(packs)))
    assert [pack.digest for pack in found.packs] == [pack.digest for pack in packs]
    assert assets.find("robots") == tmp_path / "robots"
