"""Untrusted input runs no code and opens no file: replies, scenes, profiles, packs, corpora.

Ruff's rules of pyproject.toml hold the code to what cannot make code from data.
"""

import base64
import json
import pickle
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import msgpack
import numpy as np
import pytest

from tests.cli.typed import told
from tests.packs import box, write_pack
from tests.policies.clients import groot_server, served, test_openpi, test_openvla as test_act
from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.campaign.config import default_store
from vlafuzz.common.assets import corpus_dir
from vlafuzz.errors import CatalogueError, CorpusError, UsageError
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.policies.clients import msgpack_wire, openvla
from vlafuzz.policies.clients.options import profile_options
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.worlds.tabletop.objects import open_packs

AWAY = "../../../outside"


class Bomb:
    def __reduce__(self) -> tuple:
        return (exec, ("import sys; sys.exploded = True",))


BOMB = pickle.dumps(np.array([Bomb()], dtype=object))
OBJECTS = {b"nd": True, b"type": "|O", b"kind": b"O", b"shape": [1], b"data": BOMB}
ARRAY = {"__ndarray__": True, "data": BOMB, "dtype": "|O", "shape": [1]}
REPLY = {"type": "action", "payload": {"actions": ARRAY}, "seq": 1, "timestamp": 0.0}


@pytest.mark.parametrize(
    ("unpack", "frame"),
    [
        (msgpack_wire.unpack, msgpack.packb(OBJECTS)),
        (msgpack_wire.unpack, msgpack.packb(OBJECTS | {b"type": "O8"})),
        (
            msgpack_wire.unpack,
            msgpack.packb({"__ndarray_class__": True, "as_npy": b"\x93NUMPY\x01\x00\x3b\x00"
                           b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }  \n" + BOMB}),
        ),
        (msgpack_wire.unpack_openpi, msgpack.packb({key.encode(): value for key, value in ARRAY.items()})),
        (msgpack_wire.unpack_vla_eval, msgpack.packb(REPLY)),
        (openvla.decode, json.dumps({"__numpy__": base64.b64encode(BOMB).decode(), "dtype": "|O", "shape": [1]})),
    ],
    ids=["groot", "groot, otherwise", "groot, npy", "openpi", "vla-eval", "act"],
)  # fmt: skip
def test_a_pickle_in_a_reply_is_refused(unpack: Callable, frame: bytes):
    with pytest.raises(ValueError, match="object"):
        unpack(frame)
    assert not hasattr(sys, "exploded")


def test_the_bomb_is_one():
    pickle.loads(BOMB)
    del sys.exploded


@pytest.fixture(scope="module")
def audited() -> list[list[str]]:
    """The lists in which every opened path is recorded."""
    noting: list[list[str]] = []

    def hook(event: str, arguments: tuple) -> None:
        if event in ("open", "os.listdir", "os.scandir", "os.mkdir", "os.rename", "os.remove"):
            if isinstance(arguments[0], int):  # a descriptor, of a file whose path was recorded
                return
            for paths in noting:
                paths.append(str(arguments[0]))

    sys.addaudithook(hook)  # for good: there is no way to take it off
    return noting


@pytest.fixture
def opened(audited) -> Iterator[list[str]]:
    """Paths of files and folders opened during the test."""
    audited.append([])
    yield audited[0]
    audited.clear()


POISONED = {"path": AWAY, "server": AWAY, "file": f"{AWAY}.yaml", AWAY: AWAY}
ACTIONS = {"actions": [[0.0] * 6 + [1.0]]}
SERVERS = {
    "vla-eval": lambda: served.scripted(
        lambda number: served.message("action", ACTIONS | POISONED, number),
        hello=served.HELLO | POISONED | {"model_server": AWAY, "harness_version": AWAY},
    ),
    "openpi": lambda: test_openpi.scripted(ACTIONS | POISONED, metadata=msgpack_wire.pack_openpi(POISONED)),
    "http": lambda: test_act.scripted((200, json.dumps(ACTIONS | POISONED))),
    "groot": lambda: groot_server.served(
        [groot_server.parts(np.ones((1, 1, 7))) | POISONED, POISONED],
        modalities=groot_server.config(groot_server.MODALITIES | {"video": []}) | POISONED,
    ),
}


@pytest.mark.parametrize("protocol", SERVERS)
def test_no_path_comes_from_a_reply(protocol: str, opened):
    with SERVERS[protocol]() as server:
        served.asked(f"{server if isinstance(server, str) else server[0]}?camera=0")
    assert not [path for path in opened if "outside" in path]


def test_a_server_sends_nobody_elsewhere():
    with test_act.scripted((302, "")) as (name, *_):
        assert "HTTP 302" in served.failure(f"{name}?camera=0").message


SCENE = json.loads(nominal().to_json())


@pytest.mark.parametrize(
    "change",
    [
        {"robot": AWAY},
        {"task": AWAY},
        {"targets": [SCENE["targets"][0] | {"object": AWAY}]},
        {"targets": [SCENE["targets"][0] | {"object": f"{AWAY}:can"}]},
        {"targets": [SCENE["targets"][0] | {"rest": AWAY}]},
        {"frame": AWAY},
        {"file": AWAY},
    ],
    ids=["robot", "task", "object", "pack", "rest", "frame", "more"],
)
def test_a_scene_names_no_path(change, tmp_path, monkeypatch, capsys, opened):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenes.jsonl").write_text(json.dumps(SCENE | change) + "\n")
    assert told(capsys, "lint scenes.jsonl --json", code=1)
    assert not [path for path in opened if "outside" in path]


@pytest.mark.parametrize("name", [AWAY, "/etc/hosts", "..", "a/b", "a\\b", ""])
def test_a_pack_names_no_folder_but_its_own(name, tmp_path, opened):
    folder = write_pack(tmp_path / "mine", brick=box(0.04, 0.06, 0.1))
    (folder / "info_mine.json").write_text(json.dumps({name: {"scales": [1.0]}}))
    opened.clear()
    with pytest.raises(CatalogueError, match="a name of at most 100 letters"):
        open_packs(str(folder))
    assert {Path(path) for path in opened} <= {folder, folder / "models", folder / "info_mine.json"}


@pytest.mark.parametrize("key", ["scene", "nominal"])
def test_a_corpus_names_no_file(key, tmp_path, opened):
    folder = tmp_path / "corpus"
    shutil.copytree(corpus_dir() / "mini-pick-up", folder)
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["cases"][0][key] = AWAY
    (folder / "manifest.json").write_text(json.dumps(manifest))
    opened.clear()
    with pytest.raises(CorpusError, match="no scene with digest"):
        read_corpus(folder)
    assert all(Path(path).resolve().is_relative_to(folder) for path in opened)


class TestProfiles:
    @pytest.mark.parametrize("name", ["../profiles/libero", "/libero", "..", ""])
    def test_one_of_ours_is_named_by_its_name_alone(self, name, opened):
        with pytest.raises(UsageError, match="unknown profile"):
            profile_options(name, "openpi")
        assert {Path(path).resolve().parent.name for path in opened} <= {"profiles", "clients"}

    @pytest.mark.parametrize(
        ("options", "says"),
        [
            ({"profile": AWAY}, "names another one"),
            ({"camera": AWAY}, "camera: expected pixels"),
            ({"url": AWAY}, "unknown option 'url'"),
        ],
    )
    def test_one_names_no_other_file(self, options, says, tmp_path, opened):
        path = tmp_path / "mine.yaml"
        path.write_text(json.dumps({"about": "", "source": "", "options": options, "protocols": {"openpi": {}}}))
        with pytest.raises(UsageError, match=says):
            make_policy(f"openpi:ws://127.0.0.1:9?profile={path}")
        assert not [path for path in opened if "outside" in path]


@pytest.mark.parametrize("name", ["lerobot:../../x", "python:a.b:c", "http://gpu:1/../../x?a=..", ".."])
def test_a_store_that_is_named_after_its_policy_stays_in_its_folder(name):
    store = default_store("../pick-up", name, 0)
    assert store.parent == Path("runs")
    assert Path(store.name).name == store.name
