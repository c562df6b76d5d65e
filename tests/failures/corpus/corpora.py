"""A corpus without a simulator: planted failures with made-up witnesses, and controls."""

import numpy as np

from tests.doubles import manifest, scene
from vlafuzz.failures.corpus.corpus import Case, Control, Corpus, Evidence
from vlafuzz.model import Causes, Scene, Threshold, Witness


def case(number: int = 0, *, run: int = 0, reference: Scene | None = None) -> Case:
    failing = scene(light=1 / 16, x=-0.04 + 0.001 * number)
    dim = (("light.intensity", 0.25),)
    threshold = Threshold("light", dim, 0.5, low=dim, high=dim, direction="dark", ranges=((dim, ()),))
    causes = Causes(("light",), ("light",), (threshold,))
    actions = np.random.default_rng(number).normal(size=(12, 7)).astype(np.float32)
    witness = Witness(actions, "5" * 32, 0, "seeing" if number % 2 else "expert")
    cause = {"lost_stage": "grasp", "signature": "pick-up|grasp|light:dark", "operators": ("light",), "causes": causes}
    passing = {"counterparts": {"light": scene(x=-0.04 + 0.001 * number)}, "nominal": scene(), "nominal_passes": True}
    counts = {"run": run, "repeats": 1, "failures": 1, "rollouts": 20 + number}
    shown = {"reference": reference, "witness": witness, "found": "f" * 32}
    return Case(scene=failing, **cause, **passing, **counts, **shown)


def control(number: int) -> Control:
    """Each fifth is dark; there the policy fails."""
    dark = number % 5 == 0
    return Control(scene(light=1 / 32 if dark else 1.5, x=-0.05 + 0.001 * number), passed=not dark)


def make_corpus(*cases: Case, runs: int = 1, controls: int = 0) -> Corpus:
    spent = {"search_rollouts": 120, "triage_rollouts": 240, "expert_rollouts": 36}
    evidence = Evidence(left_out={"it no longer fails": 1}, **spent)
    made = {"renderer": "llvmpipe", "versions": {"numpy": "2"}, "created": "2026-01-01T00:00:00+00:00"}
    of_runs, drawn = [manifest(seed=number) for number in range(runs)], tuple(map(control, range(controls)))
    return Corpus(name="dark", runs=of_runs, cases=cases or (case(),), controls=drawn, evidence=evidence, **made)
