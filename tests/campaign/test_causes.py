"""A run that looks for causes ends with them, each shown by a stored failure; another one may begin with them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.doubles import Backwards, ClosedForm, Raising, Scripted, Several, TinySpace, failed, manifest, passed, scene
from tests.failures.triage.planted import DARK, SPACE, TILTED
from tests.failures.triage.runners import PlantedEvaluator
from tests.worlds.reacher import Reacher
from vlafuzz.campaign import fuzz
from vlafuzz.campaign.causes import attribution, causes_like
from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.campaign.fuzz import Campaign
from vlafuzz.errors import StoreError, UsageError
from vlafuzz.model import Outcome, Scene
from vlafuzz.rollouts.executor import LocalExecutor
from vlafuzz.search.base import Cause, Genome
from vlafuzz.search.causes.strategy import Causes
from vlafuzz.search.probability import Probability
from vlafuzz.search.proposals import Random
from vlafuzz.search.registry import Own, strategy_factory
from vlafuzz.store.records import Attribution, Triaged
from vlafuzz.store.store import Store
from vlafuzz.worlds import world_of

VALUES = Reacher().space("reach", "own")  # whose random scenes take no time


def weak(scene: Scene) -> bool:
    return dict(scene.values)["strength"] < 0.6


class Faulty(ClosedForm):
    """The policy fails where the motors are weak, or the angles are misread."""

    def outcome(self, scene: Scene) -> Outcome:
        return failed() if weak(scene) or dict(scene.values)["bias"] > 0.2 else passed()


class Patient:
    """Looks for causes as usual, but never says what comes next."""

    def __init__(self, *args) -> None:
        causes = Causes(*args)
        self.ask, self.tell, self.outstanding = causes.ask, causes.tell, causes.outstanding


class Cut(Raising, Faulty):
    """Raises after so many scenes."""


def run(path: Path, executor=None, *, space=VALUES, strategy=None, watch=lambda _: None, about={}, **more):  # noqa: B006
    """The causes of a run of 100 rollouts, and its last tally; ``more``: see ``Campaign``."""
    tallies, about = [], replace(manifest(strategy="causes", budget=100, batch=4), **about)
    more |= {"space": space, "strategy": strategy or strategy_factory("causes")(space, 0, 100)}
    more |= {"executor": executor or LocalExecutor(Faulty())}
    with Store.open(path, "write") as store:
        Campaign(manifest=about, store=store, watch=lambda tally: tallies.append(tally) or watch(tally), **more).run()
        return store.causes(1), tallies[-1]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory):
    """A run's store, causes and last tally."""
    path = tmp_path_factory.mktemp("whole") / "a.db"
    return path, *run(path)


def test_a_run_keeps_the_causes_that_were_planted(whole):
    _, found, tally = whole
    assert {("strength",), ("bias",)} <= {cause.operators for cause in found.causes}
    assert tally.causes == len(found.causes)
    shares = [cause.share.value for cause in found.causes]
    assert shares == sorted(shares, reverse=True)


def test_every_cause_is_shown_by_a_failure_of_the_run(whole):
    path, found, _ = whole
    with Store.open(path) as store:
        failures = {finding.scene for finding in store.findings(1)}
    assert {cause.scene for cause in found.causes} <= failures
    assert {weak(cause.scene) for cause in found.causes if cause.operators == ("strength",)} == {True}


def told(path: Path) -> list[tuple[int, str, bool, bool]]:
    """The trials of a run in the order of its proposals."""
    with Store.open(path) as store:
        trials = sorted(store.trials(1), key=lambda trial: trial.proposal)
        return [(each.proposal, each.scene.digest, each.outcome.verdict.name, each.duplicate) for each in trials]


@pytest.mark.parametrize("make", [Several, Backwards])
def test_how_scenes_are_evaluated_changes_no_trial_and_no_cause(whole, make, tmp_path: Path):
    elsewhere, _ = run(tmp_path / "b.db", make(Faulty()))
    assert elsewhere == whole[1]
    assert told(tmp_path / "b.db") == told(whole[0])


def test_workers_that_would_wait_roll_out_random_scenes_to_come_and_few_of_them_in_vain(whole, tmp_path: Path):
    early, waiting = Several(Faulty()), Several(Faulty())
    _, tally = run(tmp_path / "a.db", early, about={"batch": 10})
    run(tmp_path / "b.db", waiting, strategy=Patient(VALUES, 0, 100), about={"batch": 10})
    assert early.waited < 0.15 < 0.3 < waiting.waited
    assert tally.rollouts == 100
    assert 0 <= early.evaluated - tally.rollouts <= 12  # those that a cause explains, which was found meanwhile


def test_a_run_with_scenes_rolled_out_early_is_cut_and_comes_to_the_same(whole, tmp_path: Path):
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "cut.db", Several(Cut(KeyboardInterrupt(), 50)))
    assert run(tmp_path / "cut.db", Several(Faulty()), resume=1)[0] == whole[1]
    assert told(tmp_path / "cut.db") == told(whole[0])


def test_a_run_that_is_interrupted_while_it_is_told_again_keeps_what_it_had(tmp_path: Path):
    class Impatient(Scripted):
        """Looks for causes, but Ctrl-C comes at once."""

        def ask(self, n: int):
            raise KeyboardInterrupt

        def causes(self) -> list[Cause]:
            return []

    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "a.db", LocalExecutor(Cut(KeyboardInterrupt(), 20)))
    with Store.open(tmp_path / "a.db") as store:
        before = store.causes(1)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "a.db", strategy=Impatient([]), resume=1)
    with Store.open(tmp_path / "a.db") as store:
        assert store.causes(1) == before


def test_a_run_that_goes_on_beyond_its_budget_draws_no_further_random_scene(whole, tmp_path: Path):
    run(tmp_path / "a.db")
    found, tally = run(tmp_path / "a.db", resume=1, more=30)
    assert 100 < tally.rollouts <= 130
    assert (found.at_random, found.probability) == (whole[1].at_random, whole[1].probability)
    assert {cause.operators for cause in whole[1].causes} <= {cause.operators for cause in found.causes}


def test_a_run_that_was_interrupted_beyond_its_budget_is_resumed_there(tmp_path: Path):
    run(tmp_path / "a.db")
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "a.db", LocalExecutor(Cut(KeyboardInterrupt(), 15)), resume=1, more=30)
    with Store.open(tmp_path / "a.db") as store:
        stored = store.rollouts(1)
    assert 100 < stored < 130
    _, tally = run(tmp_path / "a.db", resume=1)
    assert stored <= tally.rollouts <= 130


def test_a_strategy_that_looks_for_no_causes_has_none(tmp_path: Path):
    found, tally = run(tmp_path / "a.db", strategy=Random(VALUES, 0, 60))
    assert (found, tally.causes) == (None, None)


class Knowing(Scripted):
    """Proposes scenes in the dark, and knows two causes with their shares."""

    unexplained = ("one", "two")

    def __init__(self, genomes: Sequence[Genome]) -> None:
        super().__init__(genomes)
        self._genome = genomes[0]

    def causes(self) -> list[Cause]:
        rare, common = Probability(0.1, 0.05, 0.2), Probability(0.3, 0.2, 0.4)
        return [Cause(self._genome, ("wording",), 9, rare), Cause(self._genome, ("light",), 2, common)]

    def probability(self) -> Probability:
        return Probability(0.4, 0.3, 0.5)


def test_shares_and_the_probability_are_kept_and_what_no_failure_shows_has_no_scene(tmp_path: Path):
    space = TinySpace()
    genomes = [space.encode(scene(light)) for light in (0.125, 0.25, 1.0)]
    strategy = Own("python:mine:make", Knowing(genomes), 3)
    found, _ = run(tmp_path / "a.db", LocalExecutor(ClosedForm()), space=space, strategy=strategy)
    assert found == Attribution(found.causes, 2, Probability(0.4, 0.3, 0.5))
    (light, wording) = found.causes
    assert (light.scene, light.share) == (scene(0.125), Probability(0.3, 0.2, 0.4))
    assert (wording.scene, wording.failures) == (None, 9)


def test_no_bound_of_a_cause_exceeds_that_of_all_failures(tmp_path: Path):
    class Bold(Knowing):
        def causes(self) -> list[Cause]:
            return [Cause(self._genome, ("light",), 2, Probability(0.6, 0.35, 0.7))]

    space = TinySpace()
    bold = Bold([space.encode(scene(0.125))])
    found, _ = run(tmp_path / "a.db", LocalExecutor(ClosedForm()), space=space, strategy=bold)
    assert found.causes[0].share == Probability(0.4, 0.3, 0.5)


def test_a_test_that_is_a_bit_off_elsewhere_shows_a_cause_too(tmp_path: Path):
    """The strategy repeats a scene as one beside it, which may be the one that failed."""
    dark = SPACE.nominal()
    dark = Scene.from_json(dark.to_json().replace('"light":{"intensity":1.0}', '"light":{"intensity":0.25}'))
    beside = SPACE.encode(dark).copy()
    yaw = next(index for index, gene in enumerate(SPACE.genes) if gene.path == "camera.yaw")
    beside[yaw] += 2 / SPACE.genes[yaw].grid.size

    class OneCause(Scripted):
        def causes(self) -> list[Cause]:
            return [Cause(SPACE.encode(dark), ("light",), 1)]

    evaluator = PlantedEvaluator([lambda scene: DARK(scene) or TILTED(scene)])
    found, _ = run(tmp_path / "a.db", LocalExecutor(evaluator), space=SPACE, strategy=OneCause([beside]))
    (cause,) = found.causes
    assert cause.scene != dark
    assert np.isclose(cause.scene.light.intensity, 0.25)


def test_causes_are_kept_while_a_run_goes_on(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(fuzz, "EVERY", 0.0)  # after each outcome: no clock decides what is kept
    monkeypatch.setattr(fuzz, "SHARE", float("inf"))
    path = tmp_path / "a.db"

    def watch(tally):
        if tally.causes:
            with Store.open(path) as store:
                kept = store.causes(tally.run)
            if kept and kept.causes:
                raise KeyboardInterrupt  # it has gone on long enough

    with pytest.raises(KeyboardInterrupt):
        run(path, watch=watch)


NOMINAL = SPACE.nominal()
LOWER_BY = {
    "camera-orientation": replace(NOMINAL, camera=replace(NOMINAL.camera, pitch=-5.0)),
    "target-position": replace(NOMINAL, targets=(replace(NOMINAL.targets[0], x=0.06),)),
}


class TwoCauses(Scripted):
    """Proposes them and random scenes; the target appears lower, by the tilt or as it is nearer to the camera."""

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        super().__init__([SPACE.encode(one) for one in (*LOWER_BY.values(), *(SPACE.sample(rng) for _ in range(60)))])

    def causes(self) -> list[Cause]:
        return [Cause(SPACE.encode(scene), (name,), 3) for name, scene in LOWER_BY.items()]


LOWER = LocalExecutor(PlantedEvaluator([lambda scene: SPACE.measured(scene)["down"] >= 10]))


def test_causes_that_act_through_one_quantity_are_kept_as_one(tmp_path: Path):
    (cause,) = run(tmp_path / "a.db", LOWER, space=SPACE, strategy=TwoCauses())[0].causes
    assert (cause.mechanism.quantity, cause.failures) == ("down", 6)
    assert cause.scene in LOWER_BY.values()


@pytest.mark.parametrize(("operator", "bucket"), [("target-position", "minimal"), ("camera-orientation", "flaky")])
def test_of_causes_that_are_one_a_certified_one_of_this_policy_is_shown_and_none_that_did_not_hold(
    operator: str, bucket: str, tmp_path: Path
):
    run(tmp_path / "a.db", LOWER, space=SPACE, strategy=TwoCauses())
    with Store.open(tmp_path / "a.db", "write") as store:
        for policy, shown in (("another", "camera-orientation"), (store.findings(1)[0].policy_key, "target-position")):
            about = {"policy_key": policy, "deviating": (operator,), "repeats": 3, "failures": 3}
            store.settle(Triaged(scene=LOWER_BY[operator], bucket=bucket, **about))
            (cause,) = attribution(TwoCauses(), SPACE, store, 1).causes
            assert cause.scene == LOWER_BY[shown]


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The store of a run that found causes in scenes on a table."""
    path = tmp_path_factory.mktemp("old") / "old.db"
    faulty = LocalExecutor(PlantedEvaluator([lambda scene: DARK(scene) or TILTED(scene)]))
    run(path, faulty, space=SPACE, strategy=Causes(SPACE, 0, 100), about=SPACE.conditions)
    return path


def test_a_store_tells_the_next_run_its_causes_with_their_scenes(old: Path):
    like = causes_like(old, SPACE)
    with Store.open(old) as store:
        found = store.causes(1)
    assert found is not None
    assert [cause.operators for cause in like] == [cause.operators for cause in found.causes]
    assert {DARK(SPACE.decode(cause.genome)) for cause in like if cause.operators == ("light",)} == {True}


def test_scenes_of_another_task_keep_what_both_tasks_have(old: Path):
    other = world_of("put-on").space(task="put-on", robot="panda")
    (cause,) = [cause for cause in causes_like(old, other) if cause.operators == ("light",)]
    scene = other.decode(cause.genome)
    assert DARK(scene)
    assert scene.task == "put-on"
    assert replace(scene, light=other.nominal().light) == other.nominal()


def test_a_store_without_a_run_and_one_that_is_missing_are_refused(tmp_path: Path):
    Store.open(tmp_path / "empty.db", "write").close()
    with pytest.raises(UsageError, match="has no run in the world of pick-up"):
        causes_like(tmp_path / "empty.db", SPACE)
    with pytest.raises(StoreError):
        causes_like(tmp_path / "none.db", SPACE)


def test_strategies_that_learn_nothing_from_it_are_refused(old: Path, tmp_path: Path):
    asked = RunConfig(policy="frozen", task="pick-up", strategy="random", like=old, store=tmp_path / "new.db")
    with pytest.raises(UsageError, match="strategy 'random' learns nothing from it"):
        plan(asked)
