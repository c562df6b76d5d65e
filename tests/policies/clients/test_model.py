"""How policies' pictures, states and actions are called in data to train them with."""

import json
from pathlib import Path

import numpy as np
import pytest

from vlafuzz.errors import UsageError
from vlafuzz.policies.base import CameraRequest, Observation, PolicySpec
from vlafuzz.policies.clients.model import Model, interface_of
from vlafuzz.policies.clients.servers import options_of
from vlafuzz.worlds.provenance import described

OWN = np.array([0.1, 0.2, 0.3, 3.0, 0.0, 0.0, 0.5], np.float32)


def spec_of(name: str) -> str:
    return described(Model(name, options_of(name)).spec)


def test_a_policy_in_process_has_our_own_state_and_the_pictures_of_its_cameras():
    spec = PolicySpec("own", cameras=(CameraRequest("front", 64, 48), CameraRequest("wrist", 32, 32, "wrist")))
    interface = interface_of("mini", described(spec))
    assert dict(interface.pictures) == {"front": "observation.images.front", "wrist": "observation.images.wrist"}
    assert interface.state_names == ["x", "y", "z", "rx", "ry", "rz", "opening"]
    assert interface.action_names == ["dx", "dy", "dz", "drx", "dry", "drz", "gripper"]
    assert interface.spec.cameras == spec.cameras


def test_a_policy_without_cameras_is_shown_a_usual_picture():
    (camera,) = interface_of("pinhole", described(PolicySpec("pinhole", silhouettes=True))).spec.cameras
    assert (camera.name, camera.width, camera.height) == ("front", 224, 224)


def test_a_profile_says_how_state_and_actions_are_written():
    name = "openpi:ws://gpu:8000?profile=libero"
    interface = interface_of(name, spec_of(name))
    seen = Observation("one", 0, "", state=OWN)
    assert interface.state(seen) == pytest.approx([0.1, 0.2, 0.3, 3.0, 0, 0, 0.02, -0.02])
    assert len(interface.state_names) == 8
    moved = interface.written(np.array([0.05, 0, 0, 0, 0, 0.5, 1.0]))
    assert moved == pytest.approx([1, 0, 0, 0, 0, 1, -1])  # of LIBERO's units; it closes above 0


def test_a_policy_from_a_folder_keeps_its_own_names_of_pictures(tmp_path: Path):
    spec = described(PolicySpec("own", cameras=(CameraRequest("front", 64, 64),)))
    features = {"observation.images.top": {"type": "VISUAL"}, "observation.state": {"type": "STATE"}}
    (tmp_path / "config.json").write_text(json.dumps({"input_features": features}))
    alone = interface_of(f"lerobot:{tmp_path}", spec)
    assert dict(alone.pictures) == {"front": "observation.images.top"}
    named = interface_of(f"lerobot:{tmp_path}?profile=libero", spec)
    assert dict(named.pictures) == {"front": "observation.images.image"}


def test_a_spec_of_another_version_is_refused():
    with pytest.raises(UsageError, match="own is described as another version does"):
        interface_of("own", json.dumps({"action": {"warp": 9}}))


@pytest.mark.parametrize("config", ["[]", '{"input_features": [1]}', "{", '{"input_features": {}}'])
def test_a_config_that_is_none_is_a_sentence_or_ignored(tmp_path: Path, config: str):
    spec = described(PolicySpec("own", cameras=(CameraRequest("front", 64, 64),)))
    (tmp_path / "config.json").write_text(config)
    if config == '{"input_features": {}}':
        assert dict(interface_of(f"lerobot:{tmp_path}", spec).pictures)["front"].endswith("front")
    else:
        with pytest.raises(UsageError, match=r"config\.json"):
            interface_of(f"lerobot:{tmp_path}", spec)
