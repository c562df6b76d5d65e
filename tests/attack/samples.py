"""Valid input to mutate, made once."""

import atexit
import json
import shutil
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tests.failures.corpus.corpora import case, make_corpus
from tests.packs import box, can, tray, write_pack
from tests.report.stores import MANIFEST, store as write_store
from tests.worlds.tabletop.sim.scenes import CATALOGUE, CROWD, nominal
from tests.worlds.tabletop.test_vlatest import grasp, other, two
from vlafuzz.common.assets import operators_dir
from vlafuzz.failures.corpus.folder import write_corpus
from vlafuzz.model import Scene
from vlafuzz.policies.clients.options import PROFILES
from vlafuzz.worlds.tabletop.space import SearchSpace, load_operators
from vlafuzz.worlds.tabletop.tasks import TASKS


@cache
def folder() -> Path:
    made = Path(tempfile.mkdtemp(prefix="attack-samples-"))
    atexit.register(shutil.rmtree, made, ignore_errors=True)
    return made


@cache
def yamls(pattern: str) -> tuple[tuple[str, Any], ...]:
    """Text and content of shipped files."""
    files = PROFILES.glob("*.yaml") if pattern == "profile" else operators_dir().glob(pattern)
    return tuple((path.read_text(), yaml.safe_load(path.read_text())) for path in sorted(files))


@cache
def scenes() -> tuple[Scene, ...]:
    rng, made = np.random.default_rng(0), [CROWD]
    for task in TASKS:
        space = SearchSpace(load_operators(), CATALOGUE, task)
        made += [nominal(task), *(space.sample(rng) for _ in range(3))]
    turned = json.loads(CROWD.to_json())
    turned["confounders"][0] |= {"quaternion": [0.6, 0.8, 0, 0], "scale": 1.2}
    return (*made, Scene.from_json(json.dumps(turned)))


@cache
def vlatest() -> tuple[Any, ...]:
    alone, among = grasp("apple", -0.3, 0.2), grasp("opened_coke_can", -0.3, 0.2, orange=other(-0.4, 0.3))
    near = two(1, 0, apple=other(-0.2, 0.1), sponge=other(-0.4, 0.1), orange=other(-0.3, 0.3))
    return tuple({"0": scene, "1": scene, "seed": 7, "num": 2} for scene in (alone, among, near))


@cache
def pack() -> Path:
    info = folder() / "mine"
    return write_pack(info, brick=box(0.04, 0.06, 0.1), tin=can(), tray=tray())


@cache
def corpus() -> Path:
    place = folder() / "corpus"
    made = make_corpus(case(0), case(1, reference=nominal()), controls=5)
    made = replace(made, runs=[MANIFEST, replace(MANIFEST, seed=1)])
    if not place.exists():
        write_corpus(made, place)
    return place


@cache
def store() -> Path:
    """With passed, failed and triaged scenes."""
    return write_store(folder() / "sample.db", findings=2)


@cache
def untriaged() -> Path:
    """A store with work left to do, of a policy that can be made."""
    return write_store(folder() / "untriaged.db", findings=2, triaged=1, policy="frozen")


def make_all() -> None:
    """Make all samples; an error in this is none of the readers that are attacked."""
    for make in (scenes, vlatest, pack, corpus, store, untriaged):
        make()
