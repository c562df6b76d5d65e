"""``vlafuzz confirm``: the certified causes of one world in another one, which a rule plays here."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tests.cli.test_diff import aside, bright
from tests.cli.typed import told, typed
from tests.doubles import STAGES, stored
from tests.failures.corpus.corpora import case, make_corpus
from tests.failures.corpus.sides import RuleRunner
from tests.report.stores import MANIFEST
from vlafuzz.failures.corpus.folder import write_corpus
from vlafuzz.model import Outcome, Scene
from vlafuzz.rollouts import scene_runner
from vlafuzz.store.records import Manifest
from vlafuzz.worlds import world_of

OTHER = "tabletop-mujoco"
SPACE = world_of(f"{OTHER}/pick-up").space(f"{OTHER}/pick-up", "panda")


class There(RuleRunner):
    """The policy in the other world; where the target is far out, scenes are not fair."""

    space, stages = SPACE, STAGES
    asked: list[Scene]

    def evaluate(self, scenes, numbers) -> list[Outcome]:
        self.asked.extend(scenes)
        outcomes = zip(scenes, super().evaluate(scenes, numbers), strict=True)
        return [Outcome.invalid("settling", "") if scene.targets[0].x > 0.08 else one for scene, one in outcomes]


def lit(scene: Scene) -> bool:
    return scene.light.intensity > 0.5


def in_a_worker(source: Path, run: Manifest) -> There:
    There.asked = []
    return There(lit, run)


@pytest.fixture
def there(tmp_path: Path, monkeypatch) -> Callable[..., list[Scene]]:
    """Makes a corpus of three causes, and the other world with a rule; the scenes that are asked for there."""
    monkeypatch.chdir(tmp_path)

    def made(passes: Callable[[Scene], bool], **of_run: object) -> list[Scene]:
        asked = list[Scene]()
        monkeypatch.setattr(There, "asked", asked, raising=False)
        monkeypatch.setattr(scene_runner, "SimulatorSceneRunner", lambda source, run: There(passes, run))
        corpus = make_corpus(case(0), case(1), bright(2), aside(3))
        write_corpus(replace(corpus, runs=[replace(MANIFEST, policy="pinhole", **of_run)]), tmp_path / "found")
        return asked

    return made


def test_a_cause_holds_where_the_policy_fails_there_too_and_else_it_does_not(there, capsys):
    asked = there(lit)
    printed = told(capsys, ["confirm", "found", "--world", OTHER, "--json"])
    assert [one["verdict"] for one in printed["causes"]] == ["holds", "does not hold", "undecided"]
    dark, light, far = printed["causes"]
    (with_it, without), (also, _) = dark["other"], light["other"]
    assert with_it["failures"] == with_it["rollouts"] == without["rollouts"] >= 4
    assert (without["failures"], also["failures"]) == (0, 0)
    assert far["why"] == "the scene or one without it is not fair there, or crashed"
    assert {scene.task for scene in asked} == {f"{OTHER}/pick-up"}
    assert len(set(asked)) == len(asked)  # each jittered


def test_each_cause_is_one_item_and_a_sentence_counts_them(there, capsys):
    there(lit, world={"quality": "full"})  # of pictures, which look otherwise there in any case
    printed = typed(capsys, f"confirm found --world {OTHER}")
    assert "holds in tabletop-mujoco: fails 4 of 4 (42.5–100%), without it 0 of 4" in " ".join(printed.out.split())
    assert f"1 of 3 causes hold in {OTHER}, 1 do not, 1 undecided" in printed.out
    assert f"pinhole on pick-up in {OTHER}: solves 20 of 20 nominal scenes" in printed.err


def test_two_workers_say_the_same(there, capsys, monkeypatch):
    there(lit)
    alone = told(capsys, ["confirm", "found", "--world", OTHER, "--json"])
    monkeypatch.setattr(scene_runner, "SimulatorSceneRunner", in_a_worker)
    assert told(capsys, ["confirm", "found", "--world", OTHER, "--workers", "2", "--json"]) == alone


def test_where_the_policy_does_not_work_nominally_causes_are_not_compared(there, capsys):
    asked = there(lambda scene: False)
    said = typed(capsys, f"confirm found --world {OTHER}", code=4).out
    assert f"pinhole on pick-up solves 0% of nominal scenes in {OTHER}, fewer than 70%" in said
    assert len(asked) == 20


@pytest.mark.parametrize(
    ("flags", "of_run", "problem"),
    [
        ("found --world tabletop", {}, "pick-up is of this world"),
        ("found --world libero", {}, "--world libero: no task 'pick-up'"),
        (f"found --world {OTHER}", {"robot": "widowx"}, f"{OTHER} has no robot widowx"),
        (f"found --world {OTHER}", {"world": {"friction": "dry"}}, "the run has friction=dry, and"),
        (f"empty.db --world {OTHER}", {}, "empty.db: it has no certified cause"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_sentence(there, capsys, flags, of_run, problem):
    there(lambda scene: True, **of_run)
    stored(Path("empty.db"))
    assert problem in typed(capsys, f"confirm {flags}", code=2).err
