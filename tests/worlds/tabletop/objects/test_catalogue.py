"""The objects that come with vlafuzz, how they are kept, and what is refused in a file of objects."""

import hashlib
import itertools
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from PIL import Image

from vlafuzz.common import assets
from vlafuzz.errors import CatalogueError
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.objects.catalogue import BUILDER
from vlafuzz.worlds.tabletop.objects.schema import read_file
from vlafuzz.worlds.tabletop.objects.textures import paint

GRASPABLE = [
    "pepsi_can",
    "coke_can",
    "sprite_can",
    "7up_can",
    "fanta_can",
    "redbull_can",
    "blue_plastic_bottle",
    "apple",
    "orange",
    "sponge",
    "spoon",
    "carrot",
    "green_cube",
    "yellow_cube",
    "eggplant",
]
PLACES = ["plate", "large_plate", "table_cloth", "short_table_cloth", "basket"]
# Of the numbers that physics gets. If they change, raise BUILDER, or users keep the old objects.
GEOMETRY = (6, "589ef9bd541526d1")


@pytest.fixture(scope="module")
def catalogue():
    return load_catalogue()


def test_there_are_fifteen_objects_to_grasp_and_five_places(catalogue):
    assert list(catalogue.graspable()) == GRASPABLE
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


@pytest.mark.parametrize(
    ("name", "size", "mass"),
    [
        ("coke_can", (0.066, 0.066, 0.123), 0.38),
        ("blue_plastic_bottle", (0.062, 0.062, 0.203), 0.30),
        ("apple", (0.070, 0.070, 0.066), 0.20),
        ("sponge", (0.100, 0.070, 0.036), 0.035),
        ("spoon", (0.140, 0.035, 0.026), 0.045),
        ("carrot", (0.115, 0.036, 0.036), 0.055),
        ("eggplant", (0.078, 0.037, 0.037), 0.05),
        ("plate", (0.160, 0.160, 0.014), 0.30),
        ("short_table_cloth", (0.180, 0.120, 0.008), 0.06),
        ("basket", (0.184, 0.150, 0.057), 0.45),
    ],
)
def test_size_and_mass_are_as_stated(catalogue, name, size, mass):
    model = catalogue[name]
    extent = model.vertices.max(axis=0) - model.vertices.min(axis=0)
    assert model.mass == mass
    assert np.all(extent <= np.array(size) + 1e-6)
    assert np.all(extent >= 0.95 * np.array(size))  # polygons for circles
    assert np.abs(model.vertices.max(axis=0) + model.vertices.min(axis=0)).max() <= 2e-6


def test_the_basket_takes_a_lying_can(catalogue):
    inside = catalogue["basket"].container
    assert inside.width >= 0.16
    assert inside.depth >= 0.13
    assert inside.rim - inside.floor == pytest.approx(0.05)
    floor, *walls = catalogue["basket"].parts
    assert floor[:, 2].max() == pytest.approx(inside.floor)
    assert [np.abs(wall[:, 0]).min() for wall in walls[:2]] == pytest.approx([inside.width / 2] * 2)
    assert [np.abs(wall[:, 1]).min() for wall in walls[2:]] == pytest.approx([inside.depth / 2] * 2)


def test_plates_have_a_rim_that_keeps_a_lying_can(catalogue):
    for name in ("plate", "large_plate"):
        disc, *rim = catalogue[name].parts
        rises = min(piece[:, 2].max() for piece in rim) - disc[:, 2].max()
        assert rises >= 0.008
        assert min(np.hypot(*piece[:, :2].T).min() for piece in rim) * 2 >= 0.123


def test_a_footprint_goes_counter_clockwise_around_the_origin(catalogue):
    for model in map(catalogue.__getitem__, catalogue):
        for rest in model.stable_poses:
            after = np.roll(rest.footprint, -1, axis=0)
            x, y = rest.footprint.T
            assert np.all(x * after[:, 1] - y * after[:, 0] > 0), (model.name, rest.name)


def test_the_objects_to_grasp_have_distinct_colours(catalogue):
    for a, b in itertools.combinations(GRASPABLE, 2):
        assert np.linalg.norm(catalogue[a].colour - catalogue[b].colour) > 0.14, (a, b)


def test_each_object_looks_most_like_its_own_colour(catalogue):
    specs = read_file(assets.operators_dir() / "objects" / "builtin.yaml")
    # A policy that sees mean colours only must be able to tell them apart
    for name in GRASPABLE:
        pixels = np.asarray(paint(specs[name]), dtype=np.float64)[100:-100] / 255
        off = {other: np.linalg.norm(pixels.mean(axis=(0, 1)) - catalogue[other].colour) for other in GRASPABLE}
        assert min(off, key=off.get) == name


def test_a_cached_object_equals_the_built_one(tmp_path, monkeypatch):
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path / "one"))
    built = load_catalogue()["sponge"]
    files = {path.name: path.read_bytes() for path in built.visual.parent.iterdir()}
    again = load_catalogue()["sponge"]
    assert numbers(again) == numbers(built)
    assert again.density == built.density
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path / "two"))
    elsewhere = load_catalogue()["sponge"].visual.parent
    assert {path.name: path.read_bytes() for path in elsewhere.iterdir()} == files
    (elsewhere / "visual.glb").unlink()
    assert load_catalogue()["sponge"].visual.is_file()


def test_processes_that_build_at_once_get_the_same_object(tmp_path):
    code = (
        "from vlafuzz.worlds.tabletop.objects import load_catalogue; model = load_catalogue()['plate'];"
        "print(model.visual, model.visual.stat().st_size, model.vertices.sum())"
    )
    command = [sys.executable, "-c", code]
    environment = {"VLAFUZZ_CACHE": str(tmp_path), "PATH": "/usr/bin", "PYTHONPATH": ":".join(sys.path)}
    started = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    outputs = {process.communicate(timeout=60)[0] for process in started}
    assert all(process.returncode == 0 for process in started)
    assert len(outputs) == 1
    assert len(list((tmp_path / "objects").iterdir())) == 1


def test_a_cached_catalogue_loads_fast_and_without_mesh_libraries(catalogue):
    assert [catalogue[name] for name in catalogue]
    start, again = time.perf_counter(), load_catalogue()
    assert len([again[name] for name in again]) == 20
    assert time.perf_counter() - start < 0.1
    code = (
        "import sys; from vlafuzz.worlds.tabletop.objects import load_catalogue; all(load_catalogue());"
        "print([name for name in ('trimesh', 'scipy', 'PIL', 'sapien', 'torch') if name in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "[]\n"


def numbers(model) -> list:
    poses = [(pose.quaternion.tolist(), pose.height, pose.footprint.tolist()) for pose in model.stable_poses]
    return [[part.tolist() for part in model.parts], model.vertices.tolist(), poses]


def test_the_geometry_changes_only_with_the_builders_version(catalogue):
    every = repr([numbers(catalogue[name]) for name in catalogue])
    assert (BUILDER, hashlib.sha256(every.encode()).hexdigest()[:16]) == GEOMETRY


def test_the_meshes_have_textures(catalogue):
    for name in catalogue:
        (mesh,) = trimesh.load(catalogue[name].visual).geometry.values()
        assert isinstance(mesh.visual.material.baseColorTexture, Image.Image)
        assert mesh.visual.uv.min() >= 0
        assert mesh.visual.uv.max() <= 1


APPLE = {
    "role": "graspable",
    "mass": 0.2,
    "colour": [0.6, 0.1, 0.1],
    "shape": {"kind": "ball", "diameter": 0.07, "height": 0.066},
    "look": {"pattern": "fruit"},
    "rests": {"resting": {"up": [0, 0, 1]}},
}


def write(folder: Path, text: str = "", **changes: object) -> Path:
    file = folder / "mine.yaml"
    file.write_text(text or yaml.safe_dump({"objects": {"apple": APPLE | changes}}))
    return file


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mas": 1}, "objects.apple.mas: extra inputs are not permitted"),
        ({"mass": -1}, "objects.apple.mass: input should be greater than 0, got -1"),
        ({"mass": float("nan")}, "objects.apple.mass: input should be a finite number, got nan"),
        ({"role": "grasable"}, "objects.apple.role: input should be 'graspable' or 'place'"),
        ({"rests": {}}, "objects.apple.rests: dictionary should have at least 1 item"),
        ({"shape": {"kind": "bal"}}, "objects.apple.shape: input tag 'bal' found using 'kind' does not match"),
        ({"shape": {"kind": "ball", "height": 1}}, "objects.apple.shape.ball.diameter: field required"),
    ],
)
def test_a_wrong_value_is_named_with_file_and_key(tmp_path, changes, message):
    file = write(tmp_path, **changes)
    with pytest.raises(CatalogueError, match=re.escape(f"{file}: {message}")) as caught:
        load_catalogue(file)
    assert "\n" not in caught.value.message


@pytest.mark.parametrize(
    ("text", "message"),
    [("objects: [", "not YAML"), ("objects:\n  Big Apple: {}\n", "Big Apple"), ("objekts: {}\n", "objects: ")],
)
def test_a_file_of_the_wrong_form_is_named(tmp_path, text, message):
    file = write(tmp_path, text)
    with pytest.raises(CatalogueError, match=re.escape(str(file))) as caught:
        load_catalogue(file)
    assert message in caught.value.message


def test_the_digest_changes_with_any_value_and_only_then(tmp_path):
    before = load_catalogue(write(tmp_path)).digest
    assert load_catalogue(write(tmp_path)).digest == before
    assert load_catalogue(write(tmp_path, mass=0.21)).digest != before
    assert load_catalogue(write(tmp_path, look={"pattern": "peel"})).digest != before
    assert load_catalogue(write(tmp_path, friction=0.7)).digest != before


def test_a_pose_that_is_not_stable_is_refused(tmp_path):
    egg = {"kind": "egg", "length": 0.08, "radius": 0.02, "tip": 0.012}
    file = write(tmp_path, shape=egg, rests={"upright": {"up": [1, 0, 0]}})
    with pytest.raises(CatalogueError, match=r"objects\.apple\.rests\.upright: no stable face near this pose"):
        load_catalogue(file)["apple"]


def test_an_object_that_does_not_fit_into_the_gripper_is_refused(tmp_path):
    file = write(tmp_path, shape={"kind": "ball", "diameter": 0.09, "height": 0.09})
    with pytest.raises(CatalogueError, match=r"objects\.apple\.rests\.resting: nothing that the gripper"):
        load_catalogue(file)["apple"]
