"""Models are never mixed: behind an address, stored outcomes answer only for a model that is named."""

from collections.abc import Iterator
from pathlib import Path
from shutil import copy

import pytest

from tests.policies.clients.faults import Drifting
from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.cli import main
from vlafuzz.errors import PrerequisiteError
from vlafuzz.policies.clients.servers import guesses, names_its_model
from vlafuzz.policies.mini.policy import SHIPPED
from vlafuzz.policies.serving import serving
from vlafuzz.rollouts.policies import make_policy
from vlafuzz.store.store import Store

pytestmark = pytest.mark.usefixtures("folder")
FLAGS = ("--unchecked", "--no-certify", "--strategy", "random", "--budget", "12")


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    with serving(Drifting()) as name:
        yield name


def run(policy: str, *flags: str) -> list[bool]:
    """Whether each scene of the newest run was answered by another run."""
    assert main(["run", "--policy", policy, *FLAGS, "--store", "a.db", *flags]) == 0
    with Store.open(Path("a.db")) as opened:
        return [trial.duplicate for trial in opened.trials(opened.runs()[-1].id)]


def test_behind_an_address_no_stored_outcome_answers_and_the_run_says_so(server: str, capsys):
    run(server)
    capsys.readouterr()
    assert not any(run(server))  # the model may have been retrained in between
    assert f"note: {server}: nothing says which model that is" in capsys.readouterr().err


def test_findings_and_keys_of_such_runs_are_their_own(server: str):
    for _ in range(3):
        run(server)
    with Store.open(Path("a.db")) as opened:
        keys = {stored.manifest.key() for stored in opened.runs()}
        failing = {finding.scene for finding in opened.findings()}
        assert len(keys) == 3
        assert len(opened.findings()) == 3 * len(failing) > 0


@pytest.mark.parametrize("label", ["&version={}", "--label={}"])
def test_outcomes_of_a_model_that_is_named_answer_for_that_one_only(server: str, label: str, capsys):
    def named(version: str) -> list[bool]:
        how = label.format(version)
        return run(server + how) if how.startswith("&") else run(server, how)

    assert not any(named("1"))
    assert all(named("1")[:10])  # what is known costs nothing of the budget
    assert not any(named("2"))
    assert "nothing says which model" not in capsys.readouterr().err


@pytest.mark.parametrize("quality", ["full", "fast"])
def test_a_resumed_run_keeps_its_own_outcomes_and_pictures(server: str, quality: str, capsys):
    run(server, *(["--config", "quality=fast"] if quality == "fast" else []))
    with Store.open(Path("a.db"), "write") as opened:
        opened.finish(1, "interrupted", 1.0)
        (begun,) = opened.runs()
    assert begun.manifest.world.get("quality", "fast") == quality
    assert main(["run", "--resume", "--store", "a.db", "--policy", server, *FLAGS[:2]]) == 0
    assert "what answers now has to be the model with which the run began" in capsys.readouterr().err
    with Store.open(Path("a.db")) as opened:
        assert [stored.manifest for stored in opened.runs()] == [begun.manifest]


def test_built_in_policies_and_your_own_are_known_by_their_code():
    assert all(names_its_model(name) for name in ("mini", "frozen", "python:tests.doubles:make_idle"))
    assert not names_its_model("lerobot:outputs/policy")
    assert names_its_model("lerobot:outputs/policy?version=step-40000")
    assert plan(RunConfig(policy="frozen")).manifest.label == ""


def test_conventions_that_nobody_declares_are_said_one_by_one(server: str, capsys):
    address, _, options = server.partition("?")
    declared = [each for each in options.split("&") if each.startswith(("camera", "state", "deterministic"))]
    run(f"{address}?{'&'.join(declared)}&gripper=close_01&rotation=rpy")
    said = capsys.readouterr().err.splitlines()
    first = said.index(next(line for line in said if "they are guessed" in line))
    assert said[first + 1 : first + 7] == [
        "  action=eef_delta (actions move the hand)",
        "  frame=base (along the axes of the robot's base)",
        "  relative_to=target (a move starts at the last target, not at the hand)",
        "  position_scale=1 (a unit is a metre)",
        "  rotation_scale=1 (a unit is a radian)",
        "  hz=5 (actions a second)",
    ]
    whole = said[first + 7].split(": ", 2)[-1].strip("'")
    assert guesses(whole, make_policy(whole).spec) == {}


def test_an_edited_profile_is_another_policy(server: str, folder: Path):
    profile = folder / "mine.yaml"

    def key(sticky: int) -> str:
        profile.write_text(f"about: a\nsource: b\noptions: {{sticky: {sticky}}}\nprotocols: {{vla-eval: {{}}}}\n")
        named = f"{server}&profile={profile}&version=1"
        return plan(RunConfig(policy=named)).manifest.key()

    assert key(1) == key(1) != key(2)


def test_a_comparison_of_a_model_that_is_not_named_begins_anew_and_says_so(server: str, capsys):
    def compared(policy: str, store: str) -> int:
        flags = ("--strategies", "random,nsga2", "--repeats", "1", "--budget", "10", "--seed", "1")
        where = ("--triage-rollouts", "0", "--store", store)
        return main(["compare", "--policy", policy, *flags, *where])

    for _ in range(2):
        assert compared(server, "a.db") == 0
        assert capsys.readouterr().err.count("nothing says which model") == 1
    assert [compared(f"{server}&version=1", "b.db") for _ in range(2)] == [0, 0]


def test_mini_with_other_weights_is_named_by_their_folder(tmp_path: Path):
    with pytest.raises(PrerequisiteError, match=r"policy.json: not there"):
        make_policy(f"mini:{tmp_path}")
    for name in ("policy.json", "weights.safetensors"):
        copy(SHIPPED / name, tmp_path)
    named = plan(RunConfig(policy=f"mini:{tmp_path}", task="pick-up", budget=1))
    assert (named.policy.spec.name, named.place.kind) == ("mini", plan(RunConfig(policy="mini")).place.kind)
