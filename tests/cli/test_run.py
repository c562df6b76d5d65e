"""``vlafuzz run``: what it prints and keeps, how it ends, which flags it takes, also from a file."""

import json
import re
import sqlite3
from pathlib import Path

import pytest

from tests.cli.typed import IDLE, complaint, told, typed
from tests.doubles import ClosedForm, Gone, Raising, scene
from vlafuzz.campaign import config
from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.campaign.forecast import Speed
from vlafuzz.cli import main
from vlafuzz.cli.runs import checked
from vlafuzz.common.deadline import Deadline
from vlafuzz.doctor import exam
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.store.store import Store
from vlafuzz.worlds.tabletop.renderer import Renderer

pytestmark = pytest.mark.usefixtures("folder")
NAMES = ["failed", "passed", "invalid", "error"]


def run(flags: str, code: int = 0) -> None:
    assert main(["run", *IDLE, *flags.split()]) == code


def test_a_run_prints_one_json_object_and_keeps_a_store(capsys):
    summary = told(capsys, ["run", *IDLE, "--budget", "30", "--store", "a.db", "--json"])
    assert [summary[name] for name in ("rollouts", "task", "strategy", "seed")] == [30, "pick-up", "causes", 0]
    assert list(summary["verdicts"]) == NAMES
    assert summary["findings"] == summary["verdicts"]["failed"] > 0
    with Store.open(Path(summary["store"])) as store:
        assert len(store.findings(summary["run"])) == summary["findings"]


def test_a_run_at_random_ends_with_its_failure_rate(capsys):
    shown = typed(capsys, ["run", *IDLE, "--strategy", "random", "--budget", "30", "--store", "a.db"]).out
    what, sure, _ = shown.splitlines()[-3:]
    assert re.fullmatch(r"Fails in \d+ of 30 scenes that were tried; nothing has looked for causes yet\.", what)
    assert re.fullmatch(r"[\d.]+% of random scenes fail \([\d.]+–[\d.]+%\): 30 rollouts", sure)


def test_a_run_whose_time_is_over_says_so_and_how_it_goes_on(capsys, monkeypatch):
    class Short(Deadline):
        """Passes after twenty looks."""

        looks = 20

        def after(self, share: float) -> Deadline:
            return self

        @property
        def left(self) -> float:
            self.looks -= 1
            return self.looks

    assert main(["run", *IDLE, "--time", "soon"]) == 2
    assert capsys.readouterr().err.startswith("error: --time: expected a time, got 'soon'")
    monkeypatch.setattr("vlafuzz.common.deadline.deadline", lambda flag, text: Short())
    printed = typed(capsys, ["run", *IDLE, "--budget", "100", "--store", "a.db", "--time", "1h", "--json"])
    assert 0 < json.loads(printed.out)["rollouts"] < 20
    assert "stopped: its time is over; with --resume it goes on" in printed.err


def test_before_a_run_with_a_time_it_says_how_far_that_gets(capsys, monkeypatch):
    monkeypatch.setattr(exam, "usual_speed", lambda _: Speed(9.0, "slow"))
    few = ("--workers", "1", "--budget", "3", "--no-certify", "--store", "a.db")
    assert main(["run", "--policy", "frozen", *few, "--time", "20m"]) == 0
    # three rollouts of 56 answers would take 25 minutes
    assert re.search(r"about 25 min: 3 rollouts .*; --time ends it after 20 min; slow\n", capsys.readouterr().err)


def test_the_default_store_is_named_after_the_task_and_policy_and_gets_one_run_more(folder: Path):
    for _ in range(2):
        assert main(["run", *IDLE, "--budget", "3", "--seed", "7"]) == 0
    (store,) = (folder / "runs").iterdir()
    assert store.name == "pick-up-python-tests.doubles-make_idle-7.db"
    with Store.open(store) as opened:
        assert [run.manifest.seed for run in opened.runs()] == [7, 7]


def test_a_manifest_says_how_to_do_the_run_again(folder: Path):
    run("--budget 3 --store a.db --vary light,target-position --config repeats=3")
    with Store.open(folder / "a.db") as store:
        made = store.runs()[0].manifest
    assert json.loads(made.operators)["varied"] == ["light", "target-position"]
    assert json.loads(made.spec)["name"] == "idle"
    assert (made.repeats, made.value("min_distance"), made.criteria) == (3, 0.15, "strict")
    assert made.catalogue_digest
    assert made.operators_digest
    assert made.versions["numpy"]


def test_a_file_of_scenes_is_run_once_each(folder: Path, capsys):
    write_scenes(folder / "pool.jsonl", [scene(x=-0.01 * number, light=4.0) for number in range(9)])
    summary = told(capsys, ["run", *IDLE, "--scenes", "pool.jsonl", "--store", "a.db", "--json"])
    assert (summary["rollouts"], summary["budget"], summary["strategy"]) == (9, 9, "pool")


def test_a_scene_file_of_vlatest_is_to_be_imported_first(folder: Path, capsys):
    (folder / "t-grasp.json").write_text('{"0": {"model_id": "apple"}, "seed": 1, "num": 1}')
    said = typed(capsys, ["run", *IDLE, "--scenes", "t-grasp.json"], code=2).err
    assert "t-grasp.json: not JSON lines" in said
    assert "vlafuzz export FILE.json" in said


def test_where_no_scene_is_fair_the_machine_is_not_to_blame(folder: Path, capsys):
    write_scenes(folder / "pool.jsonl", [scene(x=0.1)])
    assert main(["run", *IDLE, "--scenes", "pool.jsonl", "--store", "a.db"]) == 2
    assert "hint: no scene is fair (geometry 1): narrower ranges" in capsys.readouterr().err


@pytest.mark.parametrize(("light", "code"), [(0.25, 1), (4.0, 0)])
def test_findings_are_an_exit_code_where_asked_for(folder: Path, light: float, code: int):
    write_scenes(folder / "pool.jsonl", [scene(light)])
    for _ in range(2):  # answered from the store, it is a finding all the same
        run("--scenes pool.jsonl --store a.db --config fail-on-finding=true", code)


def test_a_run_in_which_nothing_was_judged_is_no_success(monkeypatch, capsys):
    monkeypatch.setattr(config, "make_evaluator", lambda *_: Raising(ConnectionError("refused")))
    shown = typed(capsys, ["run", *IDLE, "--store", "a.db", "--config", "fail-on-finding=true"], code=3)
    assert "ConnectionError: refused" in shown.out
    assert "stopped: 8 scenes in a row ended in an error, the last: ConnectionError: refused" in shown.err
    assert "error: no scene could be judged: all " in shown.err
    assert " rollouts ended in an error, first: ConnectionError: refused\n" in shown.err


def test_a_label_is_named_before_the_policy(capsys):
    named = ("--label", "step-40000", "--budget", "10", "--store", "a.db")
    assert main(["run", *IDLE, *named]) == 0
    called = "step-40000 (python:tests.doubles:make_idle)"
    assert f"run 1: pick-up, {called}, causes, seed 0" in capsys.readouterr().out
    assert ": step-40000 on pick-up" in typed(capsys, ["report", "a.db"]).out
    row = told(capsys, ["report", "a.db", "--json"])[0]
    assert (row["policy"], row["label"]) == ("python:tests.doubles:make_idle", "step-40000")


def test_a_run_whose_policy_goes_away_says_how_to_go_on(monkeypatch, capsys):
    monkeypatch.setattr(config, "make_evaluator", lambda *_: Gone(after=20))
    asked = ["run", *IDLE, "--budget", "40", "--store", "a.db", "--json"]
    assert typed(capsys, asked, code=3).err.splitlines() == [
        "error: 8 scenes in a row had no answer: policy: connect: refused",
        "hint: when the policy is back, continue with `vlafuzz run --resume --store a.db --trust`",
    ]
    monkeypatch.setattr(config, "make_evaluator", lambda *_: ClosedForm())
    assert main(["run", "--resume", "--trust", "--store", "a.db"]) == 0


def test_a_run_of_given_scenes_finds_them_again(folder: Path, monkeypatch, capsys):
    lights = [2.0**power for power in range(-4, 5)]
    write_scenes(folder / "given.jsonl", [scene(light, y=0.05 * y) for light in lights for y in range(-2, 3)])
    given = ["run", *IDLE, "--store", "a.db", "--scenes", "given.jsonl"]
    monkeypatch.setattr(config, "make_evaluator", lambda *_: Gone(after=20))
    assert main(given) == 3
    monkeypatch.setattr(config, "make_evaluator", lambda *_: ClosedForm())
    (folder / "given.jsonl").rename(folder / "moved.jsonl")
    write_scenes(folder / "given.jsonl", [scene()])
    capsys.readouterr()
    said = typed(capsys, ["run", "--resume", "--trust", "--store", "a.db"], code=2).err
    assert f"run 1 had other scenes than {folder / 'given.jsonl'} holds\nhint: give " in said
    assert "given.jsonl as it was then" in said
    (folder / "moved.jsonl").rename(folder / "given.jsonl")
    summary = told(capsys, ["run", "--resume", "--trust", "--store", "a.db", "--json"])
    assert summary["rollouts"] == 45


def test_a_run_that_an_earlier_version_chose_from_a_file_is_not_resumed(folder: Path, monkeypatch, capsys):
    write_scenes(folder / "given.jsonl", [scene(y=0.01 * number) for number in range(30)])
    monkeypatch.setattr(config, "make_evaluator", lambda *_: Gone(after=20))
    assert main(["run", *IDLE, "--store", "a.db", "--scenes", "given.jsonl"]) == 3
    with sqlite3.connect(folder / "a.db") as database:
        database.execute("UPDATE run SET scene_file = json_set(scene_file, '$.flag', 'pool'), strategy = 'nsga2'")
    capsys.readouterr()
    said = typed(capsys, ["run", "--resume", "--trust", "--store", "a.db"], code=2).err
    assert "run 1 chose from the scenes of" in said


def test_another_version_of_the_users_code_is_not_answered_by_the_one_before(folder: Path, monkeypatch, capsys):
    monkeypatch.syspath_prepend(folder)
    code = "from tests.doubles import make_idle as make\n"
    rollouts = []
    for version in ("", "# mended\n", "# mended\n"):
        (folder / "of_mine.py").write_text(code + version)
        asked = "--policy python:of_mine:make --unchecked --store a.db --budget 20 --strategy random --json"
        rollouts.append(told(capsys, ["run", *asked.split()])["earlier"])
    assert rollouts[:2] == [0, 0]
    assert rollouts[2] >= 20


@pytest.mark.parametrize("store", [".", "runs"])
def test_a_folder_is_no_store(folder: Path, store: str, capsys):
    (folder / "runs").mkdir()
    said = typed(capsys, ["run", *IDLE, "--store", store], code=2).err.splitlines()
    assert said == [f"error: {store}: is a folder", "hint: give the file of a store in it"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--label", "a b\x1b"], "--label 'a b\\x1b': expected up to 100 letters"),
        (["--budget", "0"], "--budget: expected at least 1, got 0"),
        (["--budget", "2", "--config", "repeats=3"], "--budget: expected at least 3, got 2"),
        (["--config", "batch=0"], "batch: expected at least 1, got 0"),
        (["--workers", "0"], "--workers: expected at least 1, got 0"),
        (["--executor", "rya"], "unknown executor 'rya'"),
        (["--executor", "local", "--workers", "2"], "--executor local: it has one worker, not 2"),
        (["--executor", "local:auto"], "unknown executor 'local:auto'"),
        (["--executor", "ray:gpu"], "--executor ray:gpu: no address of a ray cluster"),
        (["--severity", "0"], "--severity 0: expected a number from 0.05 to 1, or auto"),
        (["--severity", "2"], "--severity 2: expected a number from 0.05 to 1, or auto"),
        (["--severity", "much"], "--severity much: expected a number from 0.05 to 1, or auto"),
        (["--seed", "-1"], "--seed: expected at least 0, got -1"),
        (["--seed", "9223372036854775808"], "--seed: expected at most 9223372036854775807"),
        (["--task", "pick_up"], "unknown task 'pick_up'"),
        (["--policy", "pinhol"], "unknown policy 'pinhol'"),
        (["--strategy", "radnom"], "unknown strategy 'radnom'"),
        (["--vary", "lihgt"], "unknown operator 'lihgt'"),
        (["--operators", "no.yaml"], "no.yaml"),
        (["--scenes", "no.jsonl"], "no.jsonl"),
        (["--scenes", "pool.jsonl", "--strategy", "random"], "strategy 'random' makes its own scenes"),
        (["--scenes", "pool.jsonl", "--task", "put-on"], "scene 1 is of task 'pick-up', not 'put-on'"),
        (["--scenes", "pool.jsonl", "--vary", "light"], "--vary light: the scenes of --scenes are run"),
    ],
)
def test_a_wrong_flag_is_a_sentence_with_a_hint_and_makes_no_store(folder: Path, capsys, arguments, says: str):
    write_scenes(folder / "pool.jsonl", [scene()])
    assert says in complaint(capsys, ["run", *IDLE, "--store", "a.db", *arguments])
    assert not (folder / "a.db").exists()


# "auto" finds whatever cluster runs on the machine, such as that of a test beside this one.
@pytest.mark.parametrize("address", [pytest.param("auto", marks=pytest.mark.slow), "127.0.0.1:1"])
def test_a_ray_cluster_that_does_not_answer_has_to_be_started_first(monkeypatch, capsys, address: str):
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    assert main(["run", *IDLE, "--store", "a.db", "--executor", f"ray:{address}"]) == 3
    first, hint = capsys.readouterr().err.splitlines()
    assert first.startswith(f"error: --executor ray:{address}: no ray cluster answers: ")
    assert hint.startswith("hint: `ray start --head` starts one")


def test_a_run_says_why_its_policy_needs_no_pictures(capsys, monkeypatch):
    monkeypatch.setattr("vlafuzz.worlds.tabletop.renderer.probe_once", lambda: Renderer(None, None, "no device"))
    planned = plan(RunConfig(policy="frozen", strategy="random"))
    checked(planned, {}, unchecked=True)
    assert "nothing here draws pictures, so the policy is frozen" in capsys.readouterr().err
    checked(planned, {"policy": "frozen"}, unchecked=True)
    assert capsys.readouterr().err == ""


def configured(capsys, *flags: str) -> dict:
    return told(capsys, ["run", "--config", "run.yaml", "--json", *flags])


def test_a_file_says_how_to_run_and_the_command_line_wins(folder: Path, capsys):
    flags = "policy: frozen\nstrategy: random\nbudget: 2\nstop-early: true\nvary: [light, target-position]\n"
    (folder / "run.yaml").write_text(flags)
    done = configured(capsys, "--store", "a.db")
    assert (done["policy"], done["strategy"], done["rollouts"]) == ("frozen", "random", 2)
    assert configured(capsys, "--budget", "1", "--store", "b.db")["rollouts"] == 1


def test_options_are_also_given_one_by_one_and_the_last_one_counts(folder: Path, capsys):
    (folder / "run.yaml").write_text("policy: frozen\nstrategy: random\nbudget: 2\nrepeats: 1\n")
    printed = typed(capsys, "run --config run.yaml --config repeats=2 --store a.db --json")
    done = json.loads(printed.out)
    assert (done["rollouts"], done["proposals"]) == (2, 1)
    assert "note: frozen is deterministic: repeats differ only" in printed.err
    assert "'repaets' is no flag of this command" in typed(capsys, "run --config repaets=2", code=2).err


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("bugdet: 3", "'bugdet' is no flag of this command"),
        ("- budget", "not a list of flags"),
        ("budget: {a: 1}", "budget: not a value of a flag"),
        ("trust: true", "'trust' is no flag of this command"),
        ("policy: python:tests.doubles:make_idle", "which is not run just because a file names it"),
        ("budget: [", "YAML"),
        ("budget: many", "--budget"),
    ],
)
def test_a_wrong_file_of_flags_is_refused_in_a_sentence(folder: Path, capsys, text: str, says: str):
    (folder / "run.yaml").write_text(f"{text}\n")
    assert says in complaint(capsys, "run --config run.yaml")
