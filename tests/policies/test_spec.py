"""A policy's spec is checked on construction, so that no command can run one that makes no sense."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.cli.typed import typed
from vlafuzz.errors import UsageError
from vlafuzz.policies.base import ActionSpec, CameraRequest, PolicySpec

CAMERA = CameraRequest("front", 128, 128)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"gripper": "positive_open"}, "gripper: expected one of open_positive, close_positive, open_01, "),
        ({"rotation": "quaternion"}, "rotation: expected one of axis_angle, euler_xyz, rpy, got 'quat"),
        ({"relative_to": None}, "relative_to: expected one of target, current, got None"),
        ({"position_scale": float("nan")}, "position_scale: expected a finite number other than 0, got nan"),
        ({"rotation_scale": 0.0}, "rotation_scale: expected a finite number other than 0, got 0.0"),
        ({"position_scale": np.float32(1)}, "position_scale: expected a finite number"),
        ({"hz": 30}, "hz: expected a divisor of 100, got 30"),
        ({"hz": 0}, "hz: expected 1 or more, got 0"),
        ({"hz": 5.0}, "hz: expected 1 or more, got 5.0"),
        ({"sticky": -1}, "sticky: expected 0 or more, got -1"),
        ({"name": ""}, "name: expected a text, got ''"),
        ({"action": {"hz": 5}}, "action: expected an ActionSpec, got {'hz': 5}"),
        ({"cameras": [CAMERA]}, "cameras: expected a tuple of CameraRequest, got [CameraRequest"),
        ({"cameras": (CAMERA, CAMERA)}, "cameras: expected different names, got ['front', 'front']"),
        ({"execute": 0}, "execute: expected 1 or more, got 0"),
        ({"provenance": {"weights": Path("a.pt")}}, "provenance: expected texts by name, got {'weights'"),
    ],
)
def test_a_spec_that_makes_no_sense_is_refused(changes: dict[str, object], says: str):
    of_actions = changes.keys() <= vars(ActionSpec()).keys()
    with pytest.raises(UsageError) as caught:
        replace(ActionSpec() if of_actions else PolicySpec("any"), **changes)
    assert str(caught.value).startswith(f"the policy's spec: {says}")


@pytest.mark.parametrize(("width", "role"), [(0, "wrist"), (10**6, "wrist"), (64, "head")])
def test_a_camera_that_makes_no_sense_is_refused(width: int, role: str):
    with pytest.raises(UsageError, match="the policy's spec: "):
        CameraRequest("front", width, 64, role)


class Reversed:
    """Constructed with a convention that does not exist."""

    def __init__(self) -> None:
        self.spec = PolicySpec("reversed", action=ActionSpec(gripper="positive_open"))


@pytest.mark.parametrize(
    "command", [["run", "--unchecked", "--policy"], ["compare", "--policy"], ["doctor", "--policy"], ["serve"]]
)
def test_no_command_takes_a_policy_with_such_a_spec(command: list[str], tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    said = typed(capsys, [*command, "python:tests.policies.test_spec:Reversed"], code=2).err
    assert "error: the policy's spec: gripper: expected one of" in said
