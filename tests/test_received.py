"""Of a folder that somebody sent, only regular files inside it are read: corpora, packs, weights of mini."""

import ast
import json
import os
import re
import shutil
import stat
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import vlafuzz
from tests.failures.corpus.corpora import case, make_corpus
from tests.packs import box, write_pack
from vlafuzz.errors import CatalogueError, UsageError
from vlafuzz.failures.corpus.folder import read_corpus, write_corpus
from vlafuzz.policies.base import Observation
from vlafuzz.policies.mini.policy import CARD, SHIPPED, WEIGHTS
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.worlds.recording import to_png
from vlafuzz.worlds.tabletop.objects import load_catalogue, open_packs

ROOT = Path(vlafuzz.__file__).parent
SECRET = "a-private-word"
READERS = {  # modules that read received folders
    "worlds/tabletop/objects/measured.py",
    "worlds/tabletop/objects/packs.py",
    "policies/mini/policy.py",
    "failures/corpus/folder.py",
}
OPENERS = {"read_bytes", "read_json", "read_text", "load_scenes"}  # of ours, with a parameter ``inside``
BARE = {"open", "fromfile", "imread", "load_file", "memmap"} | OPENERS


def read_pack(folder: Path) -> None:
    load_catalogue(packs=open_packs(str(folder)))["received:brick"]


def read_mini(folder: Path) -> None:
    make_policy(f"mini:{folder}")


KINDS: dict[str, Callable[[Path], object]] = {"corpus": read_corpus, "pack": read_pack, "mini": read_mini}
FILES = [
    *(("corpus", name) for name in ("manifest.json", "scenes.jsonl", "counterparts.jsonl", "controls.jsonl")),
    ("corpus", "witnesses/*.npy"),
    ("pack", "info_mine.json"),
    ("pack", "models/brick/collision.obj"),
    ("pack", "models/brick/texture.png"),
    ("mini", CARD),
]


@pytest.fixture(scope="module")
def valid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("valid")
    write_corpus(make_corpus(case(), controls=1), folder / "corpus")
    write_pack(folder / "pack", brick=box(0.04, 0.06, 0.1))
    (folder / "pack/models/brick/texture.png").write_bytes(to_png(np.zeros((1, 1, 3), np.uint8)))
    (folder / "mini").mkdir()
    for name in (CARD, WEIGHTS):
        os.link(SHIPPED / name, folder / "mini" / name)
    return folder


@pytest.fixture
def received(valid: Path, tmp_path: Path, monkeypatch) -> Callable[[str], Path]:
    monkeypatch.setenv("VLAFUZZ_CACHE", str(tmp_path / "cache"))
    (tmp_path / "private").write_text(SECRET)
    return lambda kind: Path(shutil.copytree(valid / kind, tmp_path / "received", copy_function=os.link))


@pytest.mark.parametrize("kind", KINDS)
def test_a_folder_of_regular_files_is_read(kind: str, received: Callable[[str], Path]):
    KINDS[kind](received(kind))


def linked(path: Path, private: Path) -> None:
    path.symlink_to(private)


def pipe(path: Path, _: Path) -> None:
    os.mkfifo(path)


def listening(path: Path, _: Path) -> None:
    os.mknod(path, 0o600 | stat.S_IFSOCK)


def huge(path: Path, _: Path) -> None:
    with path.open("wb") as file:
        file.truncate(40 << 30)  # sparse


@pytest.mark.parametrize("replace", [linked, pipe, listening, huge])
@pytest.mark.parametrize(("kind", "name"), FILES)
def test_anything_else_is_refused_at_once(kind: str, name: str, replace, received: Callable[[str], Path]):
    folder = received(kind)
    (path,) = folder.glob(name)
    path.unlink()
    replace(path, folder.parent / "private")
    with pytest.raises(UsageError) as refused:
        KINDS[kind](folder)
    assert str(folder) in refused.value.message
    assert SECRET not in f"{refused.value.message}{refused.value.hint}"


@pytest.mark.parametrize(("kind", "name"), [("corpus", "witnesses"), ("pack", "models/brick")])
def test_no_folder_in_it_is_a_link(kind: str, name: str, received: Callable[[str], Path]):
    folder = received(kind)
    (folder / name).rename(folder.parent / "elsewhere")
    (folder / name).symlink_to(folder.parent / "elsewhere")
    with pytest.raises(UsageError, match="a link, or a path that leads out of the folder"):
        KINDS[kind](folder)


MATERIAL = "newmtl a\nmap_Kd {}\n"
GLB = '{{"images": [{{"uri": "{}"}}]}}'
DAE = "<COLLADA><library_images><image><init_from>{}</init_from></image></library_images></COLLADA>"


def binary(text: str) -> bytes:
    """The text as the first part of a GLB."""
    written = text.encode()
    return b"glTF\2\0\0\0" + bytes(4) + len(written).to_bytes(4, "little") + b"JSON" + written


@pytest.mark.parametrize(
    "outside", ["../../../private", "..\\\\..\\\\..\\\\private", "%2e%2e/../../private", "ABSOLUTE"]
)
@pytest.mark.parametrize(
    ("name", "text"),
    [("textured.obj", "mtllib {}\n"), ("a.mtl", MATERIAL), ("textured.dae", DAE), ("textured.glb", GLB)],
)
def test_a_mesh_names_no_file_outside(name: str, text: str, outside: str, received: Callable[[str], Path]):
    folder = received("pack")
    written = text.format(outside.replace("ABSOLUTE", str(folder.parent / "private")))
    content = binary(written) if name.endswith("glb") else written.encode()
    (folder / "models/brick" / name).write_bytes(content)
    with pytest.raises(CatalogueError, match=f"{name}: names .* which is not in the pack"):
        read_pack(folder)


OUT = "../../../private"
SAMPLED = "<COLLADA><sampler2D><source>{}</source></sampler2D></COLLADA>"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("textured.obj", f"v 0 0 0\rmtllib {OUT}\r".encode()),
        ("textured.obj", f"v 0 0 0\0mtllib {OUT}\n".encode()),
        ("textured.obj", f"mtllib \\\r\n{OUT}\n".encode()),
        ("textured.obj", f"mtl\\\nlib {OUT}\n".encode()),
        ("a.mtl", f"newmtl a\fmap_Kd {OUT}\n".encode()),
        ("a.mtl", f"newmtl a\nnorm_ {OUT}\n".encode()),
        ("textured.dae", SAMPLED.format(OUT).encode()),
        ("textured.dae", DAE.format(f"{OUT}<!-- -->.png").encode()),
        ("textured.dae", DAE.format(f"{OUT}<![CDATA[.png]]>").encode()),
        ("textured.dae", b'<!DOCTYPE C [<!ENTITY a "nowhere">]>' + DAE.format(f"&a;/../{OUT}").encode()),
        ("textured.glb", f"mtllib {OUT}\nv\n".encode()),
        ("textured.glb", binary(f'{{"images": [{{"uri": "{OUT}", "uri": "nowhere"}}]}}')),
        ("textured.glb", binary(f'{{"images": [{{"uri": "{OUT}"}}], "images": []}}')),
    ],
)
def test_a_name_that_only_sapien_would_find_is_not_missed(name: str, content: bytes, received: Callable[[str], Path]):
    folder = received("pack")
    (folder.parent / "private.jpg").write_text(SECRET)  # so SAPIEN calls a texture that is not declared
    (folder / "models/brick" / name).write_bytes(content)
    with pytest.raises(CatalogueError, match=f"{name}: (names .*private|no mesh)"):
        read_pack(folder)


def test_a_mesh_may_name_what_is_beside_it_and_what_is_nowhere(received: Callable[[str], Path]):
    folder = received("pack")
    (folder / "models/brick/textured.obj").write_text("mtllib materials.txt\nmtllib /home/author/a.mtl\n")
    (folder / "models/brick/materials.txt").write_text(MATERIAL.format("-s 1 1 1 texture.png"))
    read_pack(folder)
    (folder / "models/brick/materials.txt").write_text(MATERIAL.format("../../../private"))
    with pytest.raises(CatalogueError, match=r"materials.txt: names"):
        read_pack(folder)


CARDS = ("", "[]", "{}", '{"name": 1}', '{"views": 3}', '{"action": {"hz": 7}}', '{"action": {"x": 1}}')


@pytest.mark.parametrize("card", [*CARDS, '{"words": "x"}', '{"ranges": {"stem": -1}}', '{"action": {"hz": {}}}'])
def test_an_odd_card_of_mini_is_refused_in_a_sentence(card: str, received: Callable[[str], Path]):
    folder = received("mini")
    known = json.loads((folder / CARD).read_text())
    (folder / CARD).unlink()
    odd = json.loads(card) if card.startswith("{") and card != "{}" else None
    (folder / CARD).write_text(card if odd is None else json.dumps(known | odd))
    with pytest.raises(UsageError):
        read_mini(folder)


@pytest.mark.parametrize("change", [{"views": 2}, {"ranges": {"nowhere": 1.0}}, {}], ids=["views", "ranges", "bytes"])
def test_weights_that_do_not_fit_their_card_are_refused(change: dict, received: Callable[[str], Path]):
    folder = received("mini")
    card = json.loads((folder / CARD).read_text())
    (folder / CARD).unlink()
    (folder / CARD).write_text(json.dumps(card | change))
    if not change:
        (folder / WEIGHTS).unlink()
        (folder / WEIGHTS).write_bytes(b"x" * 100)
    policy = make_policy(f"mini:{folder}")
    images = {camera.name: np.zeros((128, 128, 3), np.uint8) for camera in policy.spec.cameras}
    with pytest.raises(UsageError, match=r"not the weights that policy.json describes"):
        policy.act([Observation("one", 0, "go", images=images, state=np.zeros(7, np.float32))])


def complaints(source: str) -> list[str]:
    """Calls that open a file without asking whether it is inside."""
    calls = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
    ours = [call for call in calls if isinstance(call.func, ast.Name) and call.func.id in OPENERS]
    asks = [call for call in ours if len(call.args) > 1 and call.func.id == "load_scenes"]  # type: ignore[attr-defined]
    asks += [call for call in ours if any(word.arg == "inside" for word in call.keywords)]
    bare = (call for call in calls if call not in asks)
    return [ast.unparse(call) for call in bare if re.split(r"\W", ast.unparse(call.func))[-1] in BARE]


def test_what_reads_received_folders_opens_nothing_else():
    assert {name: found for name in READERS if (found := complaints((ROOT / name).read_text()))} == {}


@pytest.mark.parametrize(
    "source", ["open(p)", "p.open()", "p.read_bytes()", "read_json(p, E)", "load_scenes(p)", "Image.open(p)"]
)
def test_a_bare_opener_would_be_noticed(source: str):
    assert complaints(source) == [source]
    assert complaints("read_json(p, E, inside=folder)") == []
