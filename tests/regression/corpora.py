"""A bundle without a simulator: planted failures with made-up witnesses."""

import numpy as np

from tests.doubles import manifest, scene
from vlafuzz.evidence import Causes, Threshold, Witness
from vlafuzz.regression.corpus import Case, Corpus, Evidence, Share


def case(number: int = 0, *, thumbnail: bytes | None = b"png", run: int = 0) -> Case:
    failing = scene(light=1 / 16, x=-0.04 + 0.001 * number)
    causes = Causes(("light",), ("light",), (Threshold("light", (("light.intensity", 0.25),), 0.5),))
    actions = np.random.default_rng(number).normal(size=(12, 7)).astype(np.float32)
    return Case(
        failing,
        "grasp",
        "pick-up|grasp|light",
        ("light",),
        causes,
        {"light": scene(x=-0.04 + 0.001 * number)},
        scene(),
        True,
        Witness(actions, "5" * 32, 0),
        "f" * 32,
        run,
        1,
        1,
        20 + number,
        thumbnail,
    )


def make_corpus(*cases: Case, runs: int = 1) -> Corpus:
    evidence = Evidence(
        9, {"confirmed": Share.of_counts(8, 9)}, {"it no longer fails": 1}, 120, 240, 36, 61.5
    )
    found = [manifest(seed=number) for number in range(runs)]
    return Corpus(
        "dark", found, cases or (case(),), evidence, "llvmpipe", {"numpy": "2"}, "2026-01-01T00:00:00+00:00"
    )
