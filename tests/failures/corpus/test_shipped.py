"""The shipped corpora are complete, their scenes fair and solved by witnesses, and the failures hold here."""

from contextlib import closing
from pathlib import Path

import pytest

from vlafuzz.common.assets import corpus_dir
from vlafuzz.failures.corpus.corpus import Corpus
from vlafuzz.failures.corpus.folder import is_corpus, read_corpus
from vlafuzz.model import Verdict
from vlafuzz.rollouts.scene_runner import SimulatorSceneRunner
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.objects import load_catalogue
from vlafuzz.worlds.tabletop.tasks import TASKS

SAMPLE, HOLD = 3, 2  # cases of each corpus that are run again; scripts/check_corpora.py runs all of them
FOLDERS = [corpus_dir() / f"mini-{task}" for task in TASKS]


@pytest.fixture(params=FOLDERS, ids=lambda folder: folder.name, scope="module")
def shipped(request: pytest.FixtureRequest) -> tuple[Path, Corpus]:
    return request.param, read_corpus(request.param)


def test_each_has_twenty_distinct_failures_with_all_proofs(shipped: tuple[Path, Corpus]):
    folder, corpus = shipped
    assert len({case.scene for case in corpus.cases}) == len(corpus.cases) >= 20
    assert (corpus.policy, f"mini-{corpus.task}") == ("mini", folder.name)
    assert "llvmpipe" in (corpus.renderer or "")
    for case in corpus.cases:
        assert set(case.counterparts) == set(case.operators)
        assert len(case.operators) > 0


def test_each_is_found_by_its_name_alone(shipped: tuple[Path, Corpus], tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder, corpus = shipped
    monkeypatch.chdir(tmp_path)
    assert is_corpus(Path(folder.name))
    assert [case.scene for case in read_corpus(Path(folder.name)).cases] == [c.scene for c in corpus.cases]
    assert not is_corpus(Path("elsewhere") / folder.name)


def test_their_scenes_are_fair(shipped: tuple[Path, Corpus]):
    _, corpus = shipped
    distance = corpus.runs[0].value("min_distance")
    unfair = [check_static(case.scene, load_catalogue(), distance) for case in corpus.cases]
    assert unfair == [None] * len(corpus.cases)


@pytest.mark.render
def test_witnesses_solve_the_scenes_and_the_policy_fails_in_them_here_too(shipped, record_property):
    """Of the failures about 98 % hold on another processor or renderer, so one of three may not."""
    folder, corpus = shipped
    cases = sorted(corpus.cases, key=lambda case: len(case.operators))[:SAMPLE]
    with closing(SimulatorSceneRunner(folder, corpus.runs[0])) as runner:
        solved = [runner.play(case.scene, case.witness.actions).verdict for case in cases]
        failures = runner.evaluate([case.scene for case in cases], [0] * SAMPLE)
        passes = runner.evaluate([next(iter(case.counterparts.values())) for case in cases], [0] * SAMPLE)
    failed = sum(outcome.verdict is Verdict.FAILED for outcome in failures)
    passed = sum(outcome.verdict is Verdict.PASSED for outcome in passes)
    figure = f"{corpus.name}: {failed} of {SAMPLE} failures hold here, {passed} counterparts"
    record_property("figure", figure)
    assert solved == [Verdict.PASSED] * len(cases)
    assert min(failed, passed) >= HOLD
