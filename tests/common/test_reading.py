"""Files from outside: whatever is in them, the reaction is a short sentence, in time and in little memory."""

import json
import resource
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.cli.typed import told, typed
from tests.packs import box, write_pack
from tests.worlds.tabletop.sim.scenes import CATALOGUE, nominal
from vlafuzz.common.reading import inflated, npy_array, read_bytes
from vlafuzz.errors import CatalogueError, SceneError, UsageError, VlafuzzError
from vlafuzz.model import Scene
from vlafuzz.model.scene_lines import load_scenes, write_scenes
from vlafuzz.policies.clients.options import load_profile
from vlafuzz.worlds.tabletop.objects import load_catalogue, open_packs
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.vlatest import read_vlatest

YAML_READERS = [load_profile, load_operators]
SCENE = json.loads(nominal().to_json())


@contextmanager
def in_little_memory(mebibytes: int = 1024) -> Iterator[None]:
    """MemoryError in this block above so much more than the process has."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + mebibytes * 2**20, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def nested_aliases(levels: int = 12) -> str:
    """330 bytes that stand for ten to the power of ``levels`` strings."""
    lines = [f"a{level}: &a{level} [{','.join([f'*a{level - 1}'] * 10)}]" for level in range(1, levels)]
    return "\n".join(["a0: &a0 [x,x,x,x,x,x,x,x,x,x]", *lines])


@pytest.mark.parametrize("read", YAML_READERS, ids=lambda read: read.__name__)
@pytest.mark.parametrize(
    ("text", "says"),
    [
        (nested_aliases(), "aliases"),
        ("a: &a [*a]", "aliases"),
        ("[" * 10_000, "nested too deeply"),
        ("a: 2001-99-99", "malformed value"),
        ("a: !!bool x", "malformed value"),
        ("# a: 1", "is empty"),
        ("a: 0x_", "malformed value"),
        ("a: " + "9" * 5000, "malformed value"),
        ("a: &a [" + "x, " * 300_000 + "]", "more than 0.5 MiB"),
        ("a: \x00", "not YAML"),
    ],
    ids=lambda text: text[:14],
)
def test_yaml_that_is_too_much_or_malformed_is_refused(read, text: str, says: str, tmp_path: Path):
    (tmp_path / "a.yaml").write_text(text)
    with in_little_memory(), pytest.raises(UsageError, match=says) as caught:
        read(tmp_path / "a.yaml")
    assert len(caught.value.message) <= 300


def test_a_huge_number_in_yaml_is_named_by_its_type(tmp_path: Path):
    (tmp_path / "a.yaml").write_text("about: 0b" + "1" * 30_000)
    with pytest.raises(UsageError, match="about: input should be a valid string, got a int"):
        load_profile(tmp_path / "a.yaml")


def test_a_file_that_extends_itself_by_detours_is_refused(tmp_path: Path):
    (tmp_path / "a.yaml").write_text(f"extends: ../{tmp_path.name}/a.yaml")
    with pytest.raises(CatalogueError, match="goes round in a circle"):
        load_operators(tmp_path / "a.yaml")


def space(tmp_path: Path, ranges: str) -> SearchSpace:
    (tmp_path / "a.yaml").write_text(f"extends: tabletop\noperators:\n  {ranges}\n")
    return SearchSpace(load_operators(tmp_path / "a.yaml"), CATALOGUE, "pick-up")


@pytest.mark.parametrize(
    "ranges",
    [
        "target-position: {nominal: [[-0.0412345678901234, 0.0], [-0.04, 0.2]]}",
        "light: {intensity: {low: 0.5, high: 2, step: 0.1, nominal: 1.2345678901234}}",
        "target-orientation: {yaw: {low: -180, high: 180, step: 15, nominal: -180}}",
    ],
    ids=["place", "light", "yaw"],
)
def test_a_nominal_value_with_many_decimals_or_at_the_end_is_one_of_its_scenes(tmp_path, ranges):
    made = space(tmp_path, ranges)
    assert made.decode(made.encode(made.nominal())) == made.nominal()


@pytest.mark.parametrize(
    ("ranges", "says"),
    [
        ("target-position: {x: {low: -0.1, high: 1.0e+300, step: 0.01}}", "less than or equal to 1000000"),
        ("target-position: {x: {low: -1, high: 1000, step: 0.000001}}", "gives over 100000 values"),
        ("light: {intensity: {low: 1.0e-300, high: 2, step: 0.00001, nominal: 1}}", "gives over 100000 values"),
        ("camera-position: {direction_step: 0.000001}", "greater than or equal to 0.01"),
    ],
)
def test_ranges_without_end_are_refused(tmp_path, ranges, says):
    with pytest.raises(CatalogueError, match=says):
        space(tmp_path, ranges)


@pytest.mark.parametrize("value", ["0.05", True, 1e300, [0.05], None])
def test_only_a_moderate_number_is_a_place(value):
    text = json.dumps(SCENE | {"targets": [SCENE["targets"][0] | {"x": value}]})
    with pytest.raises(SceneError, match=r"targets\.0\.x: "):
        Scene.from_json(text)


def test_lines_end_at_line_breaks_alone_and_may_follow_a_byte_order_mark(tmp_path: Path):
    scene = Scene.from_json(json.dumps(SCENE))
    line = scene.to_json()
    (tmp_path / "a.jsonl").write_text(f"\ufeff{line}\n{line}\n", encoding="utf-8")
    assert load_scenes(tmp_path / "a.jsonl") == [scene, scene]
    broken = line.replace("pick up", "pick\u2028up")
    (tmp_path / "a.jsonl").write_text(f"{line}\n{broken}\n", encoding="utf-8")
    with pytest.raises(SceneError, match=r"a\.jsonl:2: instruction: it has signs that cannot be seen"):
        load_scenes(tmp_path / "a.jsonl")


def test_lint_judges_all_lines_of_a_file_with_a_rotation_of_length_zero(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    turned = json.dumps(SCENE | {"confounders": [SCENE["targets"][0] | {"quaternion": [0, 0, 0, 0]}]})
    Path("a.jsonl").write_text(f"{turned}\n{json.dumps(SCENE)}\n")
    (row,) = told(capsys, "lint a.jsonl --static --json", code=1)
    assert (row["scenes"], row["valid"]) == (2, 1)
    assert "not of length 1" in row["rejections"][0]["reason"]


def test_numbers_of_thousands_of_digits_number_no_scene(tmp_path: Path):
    (tmp_path / "a.json").write_text(json.dumps({"9" * 5000: {}}))
    with pytest.raises(SceneError, match="unknown key"):
        read_vlatest(tmp_path / "a.json")


class TestMeshes:
    def measured(self, tmp_path: Path, mesh: trimesh.Trimesh | None = None, text: str = "") -> None:
        folder = write_pack(tmp_path / "mine", brick=mesh or box(0.04, 0.06, 0.1))
        if text:
            (folder / "models" / "brick" / "collision.obj").write_text(text)
        catalogue = load_catalogue(packs=open_packs(str(folder)))
        with in_little_memory():
            catalogue["mine:brick"].role  # noqa: B018 - measures it

    @pytest.mark.parametrize("scale", [100, 1000, 1e30])
    def test_other_units_than_metres_are_noticed(self, tmp_path, scale):
        with pytest.raises(CatalogueError, match=r"expected at most 2\.0 m"):
            self.measured(tmp_path, box(0.04 * scale, 0.06 * scale, 0.1 * scale))

    @pytest.mark.parametrize(
        "text", ["v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "v 0 0 0\n", "f"]
    )
    def test_what_is_no_solid_is_refused(self, tmp_path, text):
        with pytest.raises(CatalogueError, match=r"collision\.obj: "):
            self.measured(tmp_path, text=text)

    def test_hundreds_of_separate_parts_are_refused(self, tmp_path):
        many = [box(0.001, 0.001, 0.001, at=(x / 300, 0, 0)) for x in range(501)]
        with pytest.raises(CatalogueError, match="501 separate parts"):
            self.measured(tmp_path, trimesh.util.concatenate(many))


@pytest.mark.parametrize(
    "command",
    [
        ["run", "--scenes"], ["run", "--operators"], ["run", "--pack"], ["run", "--store"], ["lint"],
        ["triage"], ["replay"], ["report", "--out", "x.html"], ["regress"],
        ["export", "--out", "x.jsonl"], ["report"],
        ["lint", "a.jsonl", "--pack"],
        ["run", "--policy", "openpi:ws://127.0.0.1:9?profile=x.yaml", "--store"],
    ],
    ids=" ".join,
)  # fmt: skip
def test_a_name_that_is_too_long_for_a_file_is_an_error_in_a_sentence(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_scenes(Path("a.jsonl"), [nominal()])
    assert "error: " in typed(capsys, [*command, "n" * 300], code=2).err


ESCAPE = "\x1b]0;owned\x07\x9b31m\u202e"


class TestMessages:
    def test_they_cannot_steer_a_terminal(self):
        error = VlafuzzError(f"a server says {ESCAPE}", hint=ESCAPE)
        assert error.message == r"a server says \x1b]0;owned\x07\x9b31m\u202e"
        assert error.hint == r"\x1b]0;owned\x07\x9b31m\u202e"

    def test_they_are_one_line_with_beginning_and_end(self):
        message = VlafuzzError("begin\n" + "x" * 10_000 + "\nend").message
        assert len(message) <= 300
        assert message.startswith("begin x")
        assert message.endswith("x end")

    def test_what_comes_from_a_file_cannot_steer_a_terminal_either(self, tmp_path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        placed = SCENE["targets"][0] | {"object": ESCAPE, "rest": ESCAPE}
        lines = [SCENE | {"targets": [placed]}, SCENE | {ESCAPE: ESCAPE}]
        Path("a.jsonl").write_text("\n".join(map(json.dumps, lines)))
        shown = typed(capsys, "lint a.jsonl --static", code=1)
        assert r"\x1b]0;owned" in shown.out
        assert not {"\x1b", "\x07", "\x9b", "\u202e"} & {*shown.out, *shown.err}

    def test_nor_can_the_name_of_a_file_in_the_line_of_progress(self, tmp_path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("FORCE_COLOR", "1")  # as on a terminal
        name = "[red]\x1b]0;owned\x07.jsonl"
        Path(name).write_text(json.dumps(SCENE) + "\n")
        shown = typed(capsys, ["lint", name, "--static"])
        assert "[red]" in shown.err
        assert "\x1b]0;owned" not in shown.out + shown.err


def test_what_is_compressed_is_inflated_up_to_a_limit_only():
    assert inflated(zlib.compress(b"1234"), most=4) == b"1234"
    for data, says in ((zlib.compress(bytes(10**8)), "more than"), (zlib.compress(b"12")[:-1], "end")):
        with in_little_memory(100), pytest.raises(ValueError, match=says):
            inflated(data, most=4)


def test_an_array_is_no_larger_than_its_bytes(tmp_path: Path):
    np.save(tmp_path / "a.npy", np.ones((2, 7), dtype="<f4"))
    data = (tmp_path / "a.npy").read_bytes()
    assert npy_array(data).shape == (2, 7)
    with in_little_memory(), pytest.raises(ValueError, match="no array"):
        npy_array(data.replace(b"(2, 7), }     ", b"(2000000000,)}"))


def test_a_device_without_end_is_refused():
    with pytest.raises(UsageError, match="more than 1 MiB"):
        read_bytes(Path("/dev/zero"), UsageError, most=2**20)
