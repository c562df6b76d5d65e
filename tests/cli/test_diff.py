"""``vlafuzz diff``: two policies by the causes of their failures."""

import re
from collections import Counter
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from tests.cli.typed import told, typed
from tests.doubles import ended, manifest, passed, scene, stored
from tests.failures.corpus.corpora import case, make_corpus
from tests.failures.corpus.sides import Planned, RuleRunner, flaky
from tests.failures.corpus.test_export import CheckingRunner
from tests.failures.triage.planted import TILTED, Planted
from tests.report.stores import MANIFEST, MadeUpFilms
from vlafuzz.failures.corpus.corpus import Case
from vlafuzz.failures.corpus.diff import diff as compare_causes, known
from vlafuzz.failures.corpus.folder import write_corpus
from vlafuzz.model import Scene
from vlafuzz.rollouts import scene_runner as runner
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop import renderer
from vlafuzz.worlds.tabletop.renderer import Renderer


def bright(number: int) -> Case:
    return bright_scene(case(number), scene(light=16, x=-0.04 + 0.001 * number))


def bright_scene(planted: Case, failing: Scene) -> Case:
    return replace(planted, scene=failing, signature="pick-up|grasp|light:bright")


def aside(number: int) -> Case:
    """Fails where the target is far out, which both policies do."""
    planted = case(number)
    return replace(planted, scene=scene(x=0.1 + 0.001 * number), signature="pick-up|grasp|target-position:x")


def fails(*conditions) -> object:
    return lambda shown: not any(condition(shown) for condition in conditions)


def dark(shown: Scene) -> bool:
    return shown.light.intensity < 0.5


def dazzled(shown: Scene) -> bool:
    return shown.light.intensity > 3


def far(shown: Scene) -> bool:
    return shown.targets[0].x > 0.08


RULES = {"idle": fails(dark, far), "pinhole": fails(dazzled, far), "expert": fails()}


@pytest.fixture(autouse=True)
def corpora(tmp_path: Path, monkeypatch) -> None:
    """Of idle, which fails in the dark, and of pinhole, which is dazzled; both fail far out."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("vlafuzz.rollouts.policies.built_in", lambda: dict.fromkeys(RULES, object))
    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda source, run, policy: RuleRunner(RULES[policy], run))
    for name, policy, cases in (
        ("old", "idle", [*map(case, range(4)), *map(aside, range(2))]),
        ("new", "pinhole", [*map(bright, range(4)), *map(aside, range(2))]),
    ):
        corpus = replace(make_corpus(*cases), runs=[replace(MANIFEST, policy=policy)])
        write_corpus(corpus, tmp_path / name)


def diff(*arguments: str, capsys) -> dict:
    return told(capsys, ["diff", *arguments, "--json"])


def test_causes_are_fixed_remaining_or_new(capsys):
    printed = diff("old", "new", capsys=capsys)
    assert {each["signature"].split("|")[-1]: each["standing"] for each in printed["causes"]} == {
        "light:bright": "new",
        "target-position:x": "remaining",
        "light:dark": "fixed",
    }
    assert (printed["fixed"]["changed"], printed["fixed"]["of"], printed["fixed"]["shown"]) == (4, 6, True)
    assert (printed["new"]["changed"], printed["new"]["of"]) == (4, 6)
    back = diff("new", "old", capsys=capsys)
    standings = {each["signature"].split("|")[-1]: each["standing"] for each in back["causes"]}
    assert (standings["light:dark"], standings["light:bright"]) == ("new", "fixed")


def test_a_policy_that_fails_by_chance_is_hardly_said_to_be_fixed_in_itself():
    rng, standings = np.random.default_rng(0), Counter[str]()
    for _ in range(200):
        first, second = flaky(0.6, rng, "first"), flaky(0.6, rng, "second")
        found = known(Path("old"))
        result = compare_causes(found, replace(found, causes={}, probes=[]), (first, second), (first, second))
        standings.update(cause.standing for cause in result.causes)
    assert standings["fixed"] <= 0.05 * standings.total()
    assert standings["unclear"] > 0


def test_each_cause_has_eight_pairs_of_rollouts():
    first, second = Planned(lambda n, repeat: repeat % 2 > 0), Planned(lambda *_: True)
    found = known(Path("old"))
    compare_causes(found, replace(found, causes={}, probes=[]), (first, second), (first, second))
    assert Counter(first.calls) == Counter(second.calls)
    assert sorted(found.repeats, reverse=True)[:3] == [4, 4, 3]


def test_a_policy_may_have_another_name_now(capsys):
    printed = diff("old", "new", "--policy-b", "expert", capsys=capsys)
    assert (printed["first"], printed["second"]) == ("idle", "expert")
    assert printed["fixed"]["changed"] == printed["fixed"]["of"] == 6


def test_the_table_names_the_causes_and_a_sentence_counts_them(capsys):
    printed = typed(capsys, "diff old new")
    assert "causes of idle in pinhole: 1 fixed (p = 0.00" in printed.out
    assert "1 remaining, 1 new (p = 0.00" in printed.out
    assert "light: fails from intensity" in " ".join(printed.out.split())
    assert "6 and 6 certified failures" in printed.err


def test_a_page_shows_each_cause_with_the_rollouts_of_both_policies(monkeypatch, capsys):
    class Filmed(RuleRunner):
        def film(self, scene: Scene, actions=None):
            return replace(MadeUpFilms()(self.run, scene, actions), failed=actions is None and not self._rule(scene))

    monkeypatch.setattr(renderer, "probe_once", lambda: Renderer("made up", None, None))
    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda source, run, policy: Filmed(RULES[policy], run))
    assert "written: page.html (" in typed(capsys, "diff old new --out page.html").err
    page = Path("page.html").read_text(encoding="utf-8")
    assert "Causes of failure in pinhole, compared with idle: 1 new, 1 remaining, 1 fixed." in page
    shown = [unescape(" ".join(card.split())) for card in re.findall(r"<article.*?</article>", page, re.DOTALL)]
    told = {re.search(r'class="badge (\w+)"', card)[1]: re.findall(r"<dd>(.*?)</dd>", card)[0] for card in shown}
    assert told == {"new": "0 → 12", "remaining": "8 → 8", "fixed": "12 → 0"}
    films = [re.findall(r"<figcaption>(.*?)</figcaption>", card)[:2] for card in shown]
    assert films[0] == ["idle: passes", "pinhole: fails at grasp"]
    assert films[2] == ["idle: fails at grasp", "pinhole: passes"]


def test_two_stores_of_one_policy_are_told_apart_by_their_names_on_the_page(capsys):
    write_corpus(replace(make_corpus(*map(bright, range(4))), runs=[replace(MANIFEST, policy="idle")]), Path("later"))
    typed(capsys, "diff old later --policy-b pinhole --no-videos --out page.html")
    page = Path("page.html").read_text(encoding="utf-8")
    assert re.findall(r'<p class="of">(.*?)</p>', page) == ["idle on pick-up, old", "idle on pick-up, later"]
    assert {"idle on pick-up, old", "idle on pick-up, later"} <= set(re.findall(r'"title": ?"(.*?)"', page))


def test_a_store_without_certified_causes_still_says_which_policy_to_try(tmp_path: Path, capsys):
    stored(tmp_path / "b.db", ended(Planted([TILTED]).finding(0)), about=replace(MANIFEST, policy="pinhole"))
    printed = diff("old", "b.db", capsys=capsys)
    assert printed["counts"] == {"new": 0, "remaining": 1, "fixed": 1, "unclear": 0, "not judged": 0}
    assert "new ones unknown, as pinhole has no certified cause" in printed["verdict"]
    printed = diff("b.db", "old", capsys=capsys)
    assert "causes of pinhole in idle: none is certified, 1 new (p = " in printed["verdict"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["old", "old"], "old and old are both of the policy idle"),
        (["old", "new", "--policy-b", "nobody"], "unknown policy 'nobody'"),
        (["old", "new", "--alpha", "2"], "--alpha: expected a probability"),
        (["old", "missing.db"], "missing.db: no such store"),
    ],
)
def test_what_is_wrong_is_one_sentence(arguments: list[str], says: str, capsys):
    assert says in " ".join(typed(capsys, ["diff", *arguments], code=2).err.split())


def test_tasks_are_not_mixed(tmp_path: Path, capsys):
    stored(tmp_path / "other.db", ended(scene(), passed()), about=manifest(policy="pinhole", task="put-on"))
    said = typed(capsys, "diff old other.db", code=2).err
    assert "are of different tasks, pick-up and put-on" in " ".join(said.split())


def test_the_causes_of_a_store_are_its_minimal_findings(tilted: Path, monkeypatch, capsys):
    monkeypatch.setattr(runner, "SimulatorSceneRunner", lambda store, run, **_: CheckingRunner([TILTED]))
    said = typed(capsys, "diff a.db a.db --policy-b expert", code=2).err
    assert "neither has a certified cause" in " ".join(said.split())
    typed(capsys, "triage a.db")
    found = known(tilted)
    with Store.open(tilted) as opened:
        rows = opened.triaged()
    assert set(found.causes.values()) == {"pick-up|grasp|camera-orientation:+yaw"}
    assert set(found.causes) == {row.shrunk for row in rows}
    assert {probe.scene for probe in found.probes} == {row.shrunk for row in rows}
