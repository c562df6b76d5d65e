"""Everything that reads files, each as a function of random numbers and a folder for what it writes.

A reader may raise vlafuzz's own errors and nothing else.
"""

import json
import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import yaml

from tests.attack import mutators, samples
from tests.attack.reactions import command
from vlafuzz.common.watch import SILENT
from vlafuzz.model import Scene
from vlafuzz.model.scene_lines import is_document, read_scenes
from vlafuzz.policies.clients.options import load_profile
from vlafuzz.rollouts.policies import check_policy_name
from vlafuzz.worlds.lint import lint
from vlafuzz.worlds.manipulation.jitter import jittered
from vlafuzz.worlds.tabletop.objects import load_catalogue, open_packs
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.vlatest import read_vlatest

Rng = np.random.Generator
Reader = Callable[[Rng, Path], None]
CATALOGUE = samples.CATALOGUE


def _yaml(rng: Rng, pattern: str, path: Path) -> Path:
    files = samples.yamls(pattern)
    text, content = files[int(rng.integers(len(files)))]
    match rng.integers(3):
        case 0:
            path.write_bytes(mutators.data(rng, text.encode()))
        case 1:
            with suppress(RecursionError):  # of PyYAML's writer
                path.write_text(yaml.safe_dump(mutators.tree(rng, content)), errors="replace")
                return path
            path.write_text("[" * 5000)
        case _:
            path.write_text(json.dumps(mutators.tree(rng, content)))
    return path


def operators(rng: Rng, folder: Path) -> None:
    task = str(rng.choice(["pick-up", "move-near", "put-on", "put-in"]))
    space = SearchSpace(load_operators(_yaml(rng, "*.yaml", folder / "a.yaml")), CATALOGUE, task)
    space.encode(space.nominal())
    for _ in range(2):
        space.severities(space.decode(rng.random(space.dim)))


def profile(rng: Rng, folder: Path) -> None:
    path = _yaml(rng, "profile", folder / "a.yaml")
    load_profile(path)
    for protocol in ("openpi:ws", "http", "groot:tcp"):
        check_policy_name(f"{protocol}://127.0.0.1:9?profile={path}")


NAMES = (
    "mini", "pinhole", "expert", "python:os:getcwd",
    "vla-eval:ws://127.0.0.1:9?camera=256&wrist=1&rotation=rpy",
    "openpi:ws://host:8000?profile=libero&chunk=10&execute=5",
    "http://127.0.0.1:8000/act?camera=320x240&unnorm_key=a",
    "groot:tcp://host:5555?profile=bridge&state_key=x,y,z,roll,pitch,yaw,gripper:2",
    "lerobot:folder?device=cuda:0",
)  # fmt: skip


def policy_name(rng: Rng, folder: Path) -> None:
    check_policy_name(mutators.text(rng, str(rng.choice(NAMES))))


def _lint(path: Path) -> None:
    verdicts = lint(path, (), SILENT, settle=False)
    json.dumps(verdicts.counts, allow_nan=False)


def scene_lines(rng: Rng, folder: Path) -> None:
    kept = samples.scenes()
    lines = [kept[int(rng.integers(len(kept)))].to_json() for _ in range(3)]
    (folder / "a.jsonl").write_bytes(mutators.data(rng, "\n".join(lines).encode()))
    _lint(folder / "a.jsonl")
    if rng.random() < 0.05:
        command("lint", "--static", "-v", folder / "a.jsonl")


def scene_values(rng: Rng, folder: Path) -> None:
    """Scenes as trees with extreme values, also through what measures, encodes and writes them."""
    kept = samples.scenes()
    changed = mutators.tree(rng, json.loads(kept[int(rng.integers(len(kept)))].to_json()), times=1)
    (folder / "a.jsonl").write_text(json.dumps(changed) + "\n")
    _lint(folder / "a.jsonl")
    ((_, scene),) = read_scenes(folder / "a.jsonl")
    if isinstance(scene, Scene):
        command("export", folder / "a.jsonl", "--out", folder / "out.jsonl")
        jittered(scene, 1)


def vlatest(rng: Rng, folder: Path) -> None:
    documents = samples.vlatest()
    document = documents[int(rng.integers(len(documents)))]
    path = folder / str(rng.choice(["t-move_s-1.json", "ycb_t-grasp.json"]))
    if rng.random() < 0.3:
        path.write_bytes(mutators.data(rng, json.dumps(document).encode()))
    else:
        path.write_text(json.dumps(mutators.tree(rng, document)))
    is_document(path)
    read_vlatest(path)


def _pack(folder: Path) -> Path:
    return Path(shutil.copytree(samples.pack(), folder / "mine", dirs_exist_ok=True))


def pack_info(rng: Rng, folder: Path) -> None:
    path = _pack(folder) / "info_mine.json"
    content = json.loads(path.read_text())
    raw = rng.random() < 0.3
    path.write_bytes(mutators.data(rng, path.read_bytes()) if raw else json.dumps(mutators.tree(rng, content)).encode())
    load_catalogue(packs=open_packs(str(path.parent)))


def mesh(rng: Rng, folder: Path) -> None:
    import trimesh

    pack = _pack(folder)
    name = str(rng.choice(["brick", "tin", "tray"]))
    path = pack / "models" / name / "collision.obj"
    shape: Any = trimesh.load_mesh(path)
    if rng.random() < 0.4:
        shape.apply_scale(10.0 ** rng.uniform(-6, 40, 3 if rng.random() < 0.5 else None))
    kind = str(rng.choice(["obj", "ply"]))
    content = shape.export(file_type=kind)
    path.unlink()
    raw = content.encode() if isinstance(content, str) else content
    path.with_suffix(f".{kind}").write_bytes(mutators.data(rng, raw))
    if rng.random() < 0.3:
        path.with_name("textured.glb").write_bytes(mutators.data(rng, shape.export(file_type="glb")))
    if rng.random() < 0.2:
        path.with_name("texture.png").write_bytes(mutators.data(rng, b"\x89PNG\r\n\x1a\n" + bytes(60)))
    with mock.patch.dict(os.environ, VLAFUZZ_CACHE=str(folder)):  # objects are built here
        load_catalogue(packs=open_packs(str(pack)))[f"mine:{name}"]


READERS: dict[str, tuple[Reader, int]] = {
    "operators": (operators, 4500),
    "profiles": (profile, 3500),
    "policy names": (policy_name, 3500),
    "scene lines": (scene_lines, 3500),
    "scene values": (scene_values, 2000),
    "VLATest": (vlatest, 3500),
    "pack info": (pack_info, 1500),
    "meshes": (mesh, 500),
}
"""By name: the reader, and the number of inputs that `scripts/attack.py` gives it."""
