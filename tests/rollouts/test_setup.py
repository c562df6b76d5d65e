"""Settings of a world that suit the policy."""

import pytest

from vlafuzz.rollouts.setup import with_settings

SERVED = "openpi:ws://gpu:8000?profile=libero"


@pytest.mark.parametrize(
    ("policy", "task", "chosen", "kept"),
    [
        (SERVED, "pick-up", {}, {"quality": "full"}),
        ("lerobot:folder", "pick-up", {}, {"quality": "full"}),
        (SERVED, "pick-up", {"quality": "fast"}, {}),  # as it was before there was a choice
        ("mini", "pick-up", {}, {}),
        ("python:mine:make", "pick-up", {}, {}),
        ("mini", "pick-up", {"quality": "full"}, {"quality": "full"}),
        (SERVED, "libero_object/0", {}, {}),  # full by default
        (SERVED, "tabletop-mujoco/pick-up", {}, {}),  # has one quality
    ],
)
def test_policies_behind_servers_get_full_pictures_where_nobody_chose(policy, task, chosen, kept):
    found = with_settings({"world": {"min_distance": 0.1}, "packs": "[]"}, policy, task, chosen)
    assert found == {"world": {"min_distance": 0.1, **kept}, "packs": "[]"}
