"""The objects that come with vlafuzz, and how they are kept."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from vlafuzz.common import assets
from vlafuzz.errors import CatalogueError
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.objects.catalogue import INDEX, NUMBERS

SCRIPTS = Path(__file__).parents[4] / "scripts"
GRASPABLE = [
    "pepsi_can", "coke_can", "sprite_can", "7up_can", "fanta_can", "redbull_can", "blue_plastic_bottle", "apple",
    "orange", "sponge", "spoon", "carrot", "green_cube", "yellow_cube", "eggplant",
]  # fmt: skip
PLACES = ["plate", "large_plate", "table_cloth", "short_table_cloth", "basket"]


@pytest.fixture(scope="module")
def catalogue():
    return load_catalogue()


def test_there_are_fifteen_objects_to_grasp_and_five_places(catalogue):
    assert list(catalogue.names("graspable")) == GRASPABLE
    assert list(catalogue.names("place")) == PLACES
    assert list(catalogue) == list(catalogue.names()) == GRASPABLE + PLACES
    assert catalogue["7up_can"].spoken == "7up can"
    assert [name for name in catalogue if catalogue[name].supports] == PLACES[:4]
    assert [name for name in catalogue if catalogue[name].container] == ["basket"]


def test_an_unknown_object_or_rest_pose_is_refused_with_the_nearest_name(catalogue):
    with pytest.raises(CatalogueError, match="coke_can: no rest pose 'laying', known: standing, lying"):
        catalogue["coke_can"].stable_pose("laying")
    assert "peps_can" not in catalogue
    with pytest.raises(CatalogueError, match="no object 'peps_can'") as caught:
        catalogue["peps_can"]
    assert caught.value.hint == "did you mean 'pepsi_can'?"


def texture(model) -> np.ndarray:
    """Pixels ``(height, width, 3)``, sRGB in [0, 1]."""
    (mesh,) = trimesh.load_scene(model.visual).geometry.values()
    assert 0 <= mesh.visual.uv.min() <= mesh.visual.uv.max() <= 1
    return np.asarray(mesh.visual.material.baseColorTexture.convert("RGB")) / 255


def test_each_object_has_a_texture_and_looks_most_like_its_own_colour(catalogue):
    # A policy that sees mean colours only must be able to tell them apart
    for name in catalogue:
        colour = texture(catalogue[name])[100:-100].mean(axis=(0, 1))
        if name in GRASPABLE:
            off = {other: np.linalg.norm(colour - catalogue[other].colour) for other in GRASPABLE}
            assert min(off, key=off.get) == name


def test_stored_runs_know_the_objects_by_their_digest_which_stands_for_these_numbers(catalogue):
    models = [assets.operators_dir() / "objects" / name / NUMBERS for name in catalogue]
    numbers = hashlib.sha256(b"".join(file.read_bytes() for file in models)).hexdigest()
    assert (catalogue.digest, numbers[:16]) == ("60b651b6641f1773", "b834f45ecb0d0621")


def test_the_script_makes_what_is_shipped(catalogue, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(SCRIPTS)
    from make_objects import ENTRIES, build, mark
    from objects.schema import read_file

    entries, marks = read_file(ENTRIES), json.loads((assets.operators_dir() / "objects" / INDEX).read_text())
    assert {name: mark(name, entry) for name, entry in entries.items()} == marks
    built, shipped = build("sponge", entries["sponge"], tmp_path), catalogue["sponge"]
    assert np.allclose(built.vertices, shipped.vertices, atol=1e-5)
    assert [pose.name for pose in built.stable_poses] == [pose.name for pose in shipped.stable_poses]
    assert np.abs(texture(built) - texture(shipped)).mean() < 0.05
