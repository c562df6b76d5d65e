"""vlafuzz replay."""

import json
import sys
from collections import defaultdict
from dataclasses import replace

import pytest

from tests.cli.typed import complaint, told, typed
from tests.doubles import begun, ended, failed, manifest, passed, stored
from tests.worlds.tabletop.sim.scenes import nominal
from vlafuzz.campaign.replay import find
from vlafuzz.cli import main
from vlafuzz.model import Light, Placement
from vlafuzz.model.scene_lines import write_scenes
from vlafuzz.store.records import Triaged
from vlafuzz.store.store import Store


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    path = tmp_path_factory.mktemp("replay") / "s.db"
    flags = f"--policy frozen --strategy random --budget 2 --store {path} --config stop-early=true"
    assert main(["run", *flags.split()]) == 0
    return path


def test_it_repeats_the_first_failure_bit_by_bit(store, capsys):
    report = told(capsys, ["replay", str(store), "--json"])
    assert (report["verdict"], report["lost stage"]) == ("failed", "grasp")
    assert report["same trajectory as stored"] is True


def test_it_shows_what_the_run_named_and_not_what_was_stored_first(tmp_path, capsys):
    path = tmp_path / "s.db"
    scenes = [replace(nominal("pick-up"), light=Light(intensity=value)) for value in (0.1, 0.2)]
    stored(path, ended(scenes[0], proposal=1), ended(scenes[1]), about=manifest(policy="frozen"))
    assert told(capsys, ["replay", str(path), "--json"])["scene"] == scenes[1].digest


def test_a_replay_says_that_the_stored_trajectory_was_made_elsewhere(store, capsys, monkeypatch):
    assert told(capsys, ["replay", str(store), "--json"])["stored trajectory made"] is None
    assert "stored trajectory made" not in typed(capsys, ["replay", str(store), "--no-film"]).out
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", "AVX2")
    assert told(capsys, ["replay", str(store), "--json"])["stored trajectory made"].startswith("at another place: ")


def test_another_policy_is_another_trajectory(store, capsys):
    report = told(capsys, ["replay", str(store), "--policy", "expert", "--json"])
    assert (report["verdict"], report["same trajectory as stored"]) == ("passed", None)


def test_a_scene_that_was_never_run_is_shown_as_a_run_of_the_policy_shows_it(tmp_path):
    write_scenes(tmp_path / "s.jsonl", [nominal("pick-up")])
    policies = "openpi:ws://gpu:8000", "mini", None
    kept = [find(tmp_path / "s.jsonl", policy=policy).conditions.world for policy in policies]
    assert kept == [{"quality": "full"}, {}, {}]


def test_who_sees_nothing_is_told_of_before_the_rollout(tmp_path, capsys, monkeypatch):
    write_scenes(tmp_path / "s.jsonl", [nominal("pick-up")])
    monkeypatch.setattr("vlafuzz.worlds.tabletop.sim.env.ManiSkillEvaluator.evaluate", None)
    arguments = [str(tmp_path / "s.jsonl"), "--policy", "expert", "--seen", str(tmp_path / "seen.png")]
    assert typed(capsys, ["replay", *arguments], code=2).err.startswith("error: policy 'expert' asks for no pictures")


def test_a_scene_that_passed_is_the_same_again(tmp_path, capsys):
    write_scenes(tmp_path / "s.jsonl", [nominal("pick-up")])
    flags = ["--scenes", str(tmp_path / "s.jsonl"), "--policy", "expert", "--config", "stop-early=true"]
    typed(capsys, ["run", *flags, "--store", str(tmp_path / "s.db")])
    report = told(capsys, ["replay", str(tmp_path / "s.db"), nominal("pick-up").digest, "--json"])
    assert (report["verdict"], report["same trajectory as stored"]) == ("passed", True)


def test_what_triage_left_of_a_finding_is_run_as_the_finding_was(tmp_path, capsys):
    failing, left = nominal("pick-up"), replace(nominal("pick-up"), light=Light(2.0))
    about = manifest(policy="frozen", stop_early=True)
    with Store.open(tmp_path / "s.db", "write") as store:
        begun(store, ended(failing), about=about)
        counts = {"repeats": 1, "failures": 1, "deviating": ("light",)}
        store.settle(Triaged(scene=failing, policy_key=about.key(), bucket="minimal", shrunk=left, **counts))
    assert told(capsys, ["replay", str(tmp_path / "s.db"), left.digest, "--json"])["policy"] == "frozen"


@pytest.mark.parametrize("given", ["", nominal("pick-up").digest])
@pytest.mark.parametrize(("policy", "expected"), [(None, "frozen"), ("expert", "expert"), ("random", "frozen")])
def test_a_finding_is_replayed_as_it_was_found_whatever_ran_its_scene_later(tmp_path, given, policy, expected):
    for name, outcome in (("frozen", failed()), ("expert", passed())):
        path = stored(tmp_path / "s.db", ended(nominal("pick-up"), outcome), about=manifest(policy=name))
    wanted = find(path, given or None, policy)
    assert wanted.conditions.policy == expected


def test_what_cannot_be_run_is_a_sentence(tmp_path, capsys):
    unknown = replace(nominal("pick-up"), targets=(Placement("nope", "standing", 0.0, 0.0),))
    write_scenes(tmp_path / "s.jsonl", [unknown])
    said = typed(capsys, ["replay", str(tmp_path / "s.jsonl"), "--policy", "pinhole"], code=2)
    assert said.err.startswith(f"error: {unknown.digest[:12]} could not be run: ")
    assert "nope" in said.err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nowhere.db"], "nowhere.db: no such file"),
        (["{store}", "zzz"], "no scene 'zzz'"),
        (["{store}", "--policy", "expart"], "unknown policy 'expart'"),
    ],
)
def test_bad_input_is_one_sentence_with_a_hint(store, arguments, says, capsys):
    assert says in complaint(capsys, ["replay", *(word.format(store=store) for word in arguments)])


def test_a_replay_says_what_is_unusual_in_the_scene(tmp_path, capsys):
    scenes = tmp_path / "s.jsonl"
    write_scenes(scenes, [replace(nominal("pick-up"), light=Light(0.25))])
    assert told(capsys, ["replay", str(scenes), "--policy", "frozen", "--json"])["unusual"] == ["light: × 0.25"]


@pytest.mark.render
def test_a_film_that_nobody_names_is_beside_its_source(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("vlafuzz.cli.replay.SIZE", 64)  # a smaller one takes less time
    write_scenes(tmp_path / "s.jsonl", [nominal("pick-up")])
    said = typed(capsys, ["replay", str(tmp_path / "s.jsonl"), "--policy", "expert"]).err
    film = tmp_path / f"s-{nominal('pick-up').digest[:12]}.mp4"
    assert "".join(said.split()) == f"written:{film}"  # wrapped in narrow terminals
    assert film.is_file()


@pytest.mark.render
def test_a_film_shows_the_rollout(store, tmp_path, monkeypatch, capsys):
    import cv2

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("vlafuzz.cli.replay.SIZE", 128)
    typed(capsys, ["replay", str(store), "--video", "v.mp4"])
    video = cv2.VideoCapture("v.mp4")
    frames = [video.read()[1] for _ in range(int(video.get(cv2.CAP_PROP_FRAME_COUNT)))]
    assert len(frames) > 80
    assert frames[0].std() > 10


def test_a_recording_for_rerun_has_what_is_where_and_what_is_reached_in_seconds(tmp_path, monkeypatch, capsys):
    pytest.importorskip("rerun", reason="needs the extra rerun")
    monkeypatch.setattr("vlafuzz.cli.replay.SIZE", 64)
    scenes, recording = tmp_path / "s.jsonl", tmp_path / "r.rrd"
    write_scenes(scenes, [nominal("pick-up")])
    report = told(capsys, ["replay", str(scenes), "--policy", "expert", "--rrd", str(recording), "--json"])
    rows = rows_of(recording)
    way = [row for row in rows["/world/hand"] if "Points3D:positions" in row]
    assert [round(row["time"].total_seconds(), 3) for row in way] == [n / 5 for n in range(report["steps"] + 1)]
    said = [row["TextLog:text"] for row in rows["/stage"]]
    assert said == ["told: pick up pepsi can", "reached: grasp", "reached: lift", "reached: success"]
    assert "pepsi_can touches hand" in {row["TextLog:text"] for row in rows["/contacts"]}
    first, *_, last = (
        row["Transform3D:translation"] for row in rows["/world/pepsi_can"] if "Transform3D:translation" in row
    )
    assert last[2] - first[2] > 0.02  # metres: it is lifted
    assert rows["/world/camera"]
    assert any("Mesh3D:vertex_positions" in row for row in rows["/world/table"])
    assert len(pytest.importorskip("rerun.chunk").RrdReader(recording).blueprints()) == 1


@pytest.mark.parametrize("exact", [True, False])
def test_a_recording_of_a_stored_failure_executes_its_actions_and_asks_no_model(
    exact, store, tmp_path, monkeypatch, capsys
):
    pytest.importorskip("rerun", reason="needs the extra rerun")
    monkeypatch.setattr("vlafuzz.cli.replay.SIZE", 64)
    monkeypatch.setattr("vlafuzz.campaign.replay.make_policy", None)
    other = stored(tmp_path / "s.db", ended(nominal("pick-up"), failed()), about=manifest(policy="frozen"))
    said = typed(capsys, ["replay", str(store if exact else other), "--rrd", str(tmp_path / "r.rrd"), "--json"])
    report = json.loads(said.out)
    assert (report["policy"], report["verdict"], report["same trajectory as stored"]) == ("frozen", "failed", exact)
    assert ("--policy frozen asks the policy again" in " ".join(said.err.split())) is not exact


def rows_of(path):
    """The rows of a recording by entity, with the first of a row's several values."""
    rows = defaultdict(list)
    for chunk in pytest.importorskip("rerun.chunk").RrdReader(path).stream():
        for row in chunk.to_record_batch().to_pylist():
            told = {
                key: value[0] if isinstance(value, list) else value for key, value in row.items() if value is not None
            }
            rows[chunk.entity_path].append(told)
    return rows


def test_without_rerun_its_recording_is_refused_with_what_to_install(store, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    said = complaint(capsys, ["replay", str(store), "--rrd", str(tmp_path / "r.rrd")], code=3)
    assert said.startswith("error: --rrd needs the package 'rerun'")
    assert "pip install" in said


@pytest.mark.render
def test_no_film_is_made_for_a_machine_or_on_demand(store, capsys):
    before = set(store.parent.iterdir())
    assert main(["replay", str(store), "--json"]) == 0
    assert main(["replay", str(store), "--no-film"]) == 0
    assert set(store.parent.iterdir()) == before
