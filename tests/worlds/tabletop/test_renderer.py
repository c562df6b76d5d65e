import pytest

from vlafuzz.campaign.config import RunConfig, plan
from vlafuzz.errors import PrerequisiteError
from vlafuzz.worlds.tabletop import renderer


@pytest.mark.render
def test_the_picture_comes_out_and_names_the_device():
    result = renderer.probe()
    assert result.device
    assert str(result).startswith("rendering works: ")


def test_without_a_vulkan_driver_it_says_so(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("VK_DRIVER_FILES", "/nonexistent")
    monkeypatch.setenv("VK_ICD_FILENAMES", "/nonexistent")
    result = renderer.probe()
    assert not result.works
    assert str(result).startswith("rendering does not work: ")


@pytest.mark.parametrize(
    ("child", "problem"),
    [
        ("import os; os.abort()", "it crashed with signal 6"),
        ("import sys; sys.exit('no luck')", "no luck"),
        ("while True: pass", "no answer within 1 s"),
    ],
)
def test_whatever_the_child_does_is_a_line(child: str, problem: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(renderer, "_CHILD", child)
    assert renderer.probe(timeout=1) == renderer.Renderer(None, None, problem)


class Device:
    """SAPIEN's."""

    def __init__(self, name: str) -> None:
        self.name = name


@pytest.mark.parametrize(("driver", "chosen"), [(True, "cuda"), (False, "cpu")])
def test_a_gpu_without_a_vulkan_driver_leaves_rendering_to_the_processor(monkeypatch, driver: bool, chosen: str):
    """As in a container that has CUDA, but none of the driver's graphics."""
    import sapien

    def system(device: Device) -> None:
        if not driver and device.name == "cuda":
            raise RuntimeError('Failed to find a supported physical device "cuda:0"')

    monkeypatch.setattr(sapien, "Device", Device)
    monkeypatch.setattr(sapien.render, "RenderSystem", system)
    assert renderer.rendering_device().name == chosen


def test_a_policy_that_sees_is_not_run_where_nothing_can_be_drawn(monkeypatch: pytest.MonkeyPatch):
    """Every rollout of it would end in an error."""
    monkeypatch.setattr(renderer, "probe_once", lambda: renderer.Renderer(None, None, "no device"))
    with pytest.raises(PrerequisiteError, match="pictures need a renderer"):
        plan(RunConfig(policy="mini", budget=5))
    assert plan(RunConfig(policy="frozen", budget=5))
