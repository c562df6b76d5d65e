"""What `vlafuzz run` says of defaults that follow from the machine."""

from vlafuzz.campaign.config import Plan, RunConfig, plan
from vlafuzz.cli.run import note_defaults
from vlafuzz.worlds.tabletop.renderer import Renderer


def planned(**flags) -> Plan:
    return plan(RunConfig(policy="frozen", strategy="random", **flags))


def test_a_run_says_when_its_batch_leaves_cores_idle(capsys, monkeypatch):
    monkeypatch.setenv("VLAFUZZ_WORKERS", "16")
    note_defaults(planned(batch=2), {})
    assert "2 scenes at a time keep 2 of 16 cores busy; --config batch=16 is faster" in capsys.readouterr().err
    note_defaults(planned(batch=2, workers=2), {"workers": 2})
    assert capsys.readouterr().err == ""


def test_a_run_says_why_its_policy_needs_no_pictures(capsys, monkeypatch):
    monkeypatch.setattr("vlafuzz.worlds.tabletop.renderer.probe_once", lambda: Renderer(None, None, "no device"))
    note_defaults(planned(), {})
    assert "nothing here draws pictures, so the policy is frozen" in capsys.readouterr().err
    note_defaults(planned(), {"policy": "frozen"})
    assert capsys.readouterr().err == ""
