"""Folders that somebody sent, with links, pipes, sockets and sparse files in them.

What lies beside such a folder holds a word that must not be read, shown, or told.
"""

import base64
import json
import os
import shutil
import stat
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from tests.attack import mutators, samples
from tests.attack.readers import Reader, Rng, cache_in
from tests.policies.clients.served import STATE
from vlafuzz.errors import VlafuzzError
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.policies.base import Observation
from vlafuzz.policies.mini.policy import CARD
from vlafuzz.report.page import render
from vlafuzz.report.sources import view_of_corpus
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.worlds.tabletop.objects import load_catalogue, open_packs

SECRET = "a-word-from-elsewhere"
_SHOWN = [base64.b64encode(SECRET.encode()[start:])[2:-4].decode() for start in range(3)]
REFERENCES = [
    ("textured.obj", "mtllib {}\n"),
    ("textured.obj", "v 0 0 0\rmtllib {}\r"),
    ("textured.obj", "mtl\\\nlib {}\n"),
    ("a.mtl", "newmtl a\nmap_Kd -s 1 1 1 {}\n"),
    ("a.mtl", "newmtl a\fnorm_ {}\n"),
    ("textured.dae", "<COLLADA><image><init_from>{}</init_from></image></COLLADA>"),
    ("textured.dae", "<COLLADA><sampler2D><source>{}<!-- -->.</source></sampler2D></COLLADA>"),
]
_outside: list[str] = []  # the folder of which nothing may be opened, while there is one


@cache
def _watched() -> list[str]:
    """Paths outside that were opened since the last input."""
    opened: list[str] = []

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        path = arguments[0] if _outside and event == "open" else None
        if isinstance(path, str | os.PathLike) and os.path.realpath(path).startswith(_outside[0]):
            opened.append(str(path))

    sys.addaudithook(hook)  # for good: there is no way to take it off
    return opened


def _received(rng: Rng, sample: Path, folder: Path) -> Path:
    """A spoiled copy of a valid folder, beside one with a secret."""
    outside = folder / "outside"
    outside.mkdir()
    for name in ("secret", "secret.json", "secret.png", "info_mine.json", "collision.obj"):
        (outside / name).write_text(json.dumps({SECRET: SECRET}))
    root = Path(shutil.copytree(sample, folder / "received", copy_function=os.link))
    for _ in range(int(rng.integers(1, 4))):
        paths = sorted(root.rglob("*"))
        if paths:
            _spoil(rng, paths[int(rng.integers(len(paths)))], root, outside)
    return root


def _spoil(rng: Rng, path: Path, root: Path, outside: Path) -> None:
    own = path.is_file() and not path.is_symlink()  # else its content may be from outside
    content = path.read_bytes() if own and path.stat().st_size < 1 << 24 else b""
    if path.is_dir() and not path.is_symlink():
        path.rename(outside / f"moved-{rng.integers(1 << 40)}")
    else:
        path.unlink()
    inside = sorted(other for other in root.rglob("*") if other != path)
    targets = [*outside.iterdir(), *inside, Path("/dev/zero"), Path("/proc/self/environ"), path, root / "nowhere"]
    match rng.integers(9):
        case 0 | 1:
            path.symlink_to(targets[int(rng.integers(len(targets)))])
        case 2:
            path.symlink_to(os.path.relpath(outside / "secret", path.parent))
        case 3:
            os.mkfifo(path)
        case 4:
            os.mknod(path, 0o600 | stat.S_IFSOCK)
        case 5:
            with path.open("wb") as file:
                file.write(content)
                file.truncate(int(rng.choice([1 << 16, 1 << 26, (1 << 26) + 1, 1 << 32, 40 << 30, 1 << 42])))
        case 6:
            path.mkdir()
        case 7 if path.suffix == ".json" and content:
            path.write_text(json.dumps(mutators.tree(rng, _json(content))))
        case _:
            path.write_bytes(mutators.data(rng, content))


def _json(content: bytes) -> object:
    try:
        return json.loads(content)
    except ValueError:
        return {}


def _attack(rng: Rng, sample: Path, folder: Path, read: Callable[[Rng, Path], str]) -> None:
    """Read a spoiled folder: neither what is read nor what is said may be from outside."""
    root = _received(rng, sample, folder)
    opened = _watched()
    opened.clear()
    _outside[:] = [os.path.realpath(folder / "outside")]
    try:
        shown = read(rng, root)
    except VlafuzzError as error:
        _check(f"{error.message}{error.hint}", opened)
        raise
    finally:
        _outside.clear()
    _check(shown, opened)


def _check(shown: str, opened: list[str]) -> None:
    assert not opened, f"reads {opened}"
    assert not [word for word in (SECRET, *_SHOWN) if word in shown], "shows what is outside"


def _read_corpus(rng: Rng, root: Path) -> str:
    corpus = read_corpus(root)
    return render(view_of_corpus(root, corpus)) if rng.random() < 0.2 else repr(corpus.cases)


def _read_pack(rng: Rng, root: Path) -> str:
    models = [path for path in root.glob("models/*") if path.is_dir()]
    if models and rng.random() < 0.4:
        name, text = REFERENCES[int(rng.integers(len(REFERENCES)))]
        target = str(rng.choice(["../../../outside/secret", f"{root.parent}/outside/secret.png", "texture.png"]))
        place = models[int(rng.integers(len(models)))] / name
        if place.resolve() == place:  # behind no link
            place.write_text(text.format(target))
    with cache_in(root.parent / "cache"):
        catalogue = load_catalogue(packs=open_packs(str(root)))
        own = [name for name in catalogue if ":" in name]
        files = (file for name in own for file in (root / "models" / name.partition(":")[2]).iterdir())
        accepted = [file for file in files if file.is_file() and b"/outside/" in file.read_bytes()]
        assert not accepted, f"accepts {accepted}"
        return repr(catalogue[own[int(rng.integers(len(own)))]])


def _read_mini(rng: Rng, root: Path) -> str:
    policy = make_policy(f"mini:{root}")
    if rng.random() < 0.1:
        images = {camera.name: np.zeros((128, 128, 3), np.uint8) for camera in policy.spec.cameras}
        policy.act([Observation("one", 0, "go", images=images, state=np.asarray(STATE, np.float32))])
    return repr(policy.spec)


def received_corpus(rng: Rng, folder: Path) -> None:
    _attack(rng, samples.corpus(), folder, _read_corpus)


def received_pack(rng: Rng, folder: Path) -> None:
    _attack(rng, samples.pack(), folder, _read_pack)


def received_mini(rng: Rng, folder: Path) -> None:
    sample = samples.mini()
    if rng.random() < 0.5:  # a card that is otherwise as it was
        sample = Path(shutil.copytree(sample, folder / "card", copy_function=os.link))
        (sample / CARD).unlink()
        card = mutators.tree(rng, json.loads((samples.mini() / CARD).read_text()))
        (sample / CARD).write_text(json.dumps(card))
    _attack(rng, sample, folder, _read_mini)


FOLDERS: dict[str, tuple[Reader, int]] = {
    "received corpora": (received_corpus, 5000),
    "received packs": (received_pack, 3500),
    "received mini": (received_mini, 3500),
}
"""As ``READERS``."""
