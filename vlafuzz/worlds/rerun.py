"""A rollout as a recording for the viewer of Rerun (rerun.io): things, hand, camera and its pictures over time."""

from pathlib import Path
from typing import Any

import numpy as np

from vlafuzz.common.arrays import Array
from vlafuzz.common.files import replacing, writing
from vlafuzz.errors import install
from vlafuzz.policies.clients.servers import needed
from vlafuzz.worlds.episode import Episode
from vlafuzz.worlds.recording import Recording
from vlafuzz.worlds.sight import Sight

CAMERA, HAND = "world/camera", "world/hand"
RADIUS = 0.004  # metres: of the hand's path, thinner than a finger
BESIDE = np.array([-0.1, 0.7, 0.1])  # metres forward, left and up of the camera: it is in view, and hides nothing


class RerunRecording(Recording):
    """A recording that also keeps what is where, and the stages of the task. Time is in seconds of the rollout.

    Of a world that does not say what is where there are pictures and stages only; without ``size``, no pictures.
    A PrerequisiteError without the package.
    """

    def __init__(self, size: int) -> None:
        super().__init__(size)
        with needed("--rrd", "rerun", hint=install("rerun")):
            import rerun
        self._rerun: Any = rerun
        self.clear()

    def clear(self) -> None:
        super().clear()
        self._stream = self._rerun.RecordingStream("vlafuzz")
        self._stream.log("world", self._rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._shaped, self._way = set[str](), list[Array]()
        self._stages, self._contacts = 0, frozenset[str]()

    def note(self, episode: Episode) -> None:
        super().note(episode)
        rerun, log, monitor = self._rerun, self._stream.log, episode.monitor
        self._stream.set_time("time", duration=len(episode.actions) / episode.hz)
        if not episode.actions:
            log("stage", rerun.TextLog(f"told: {episode.start.instruction}"))
        for stage in monitor.reached[self._stages :]:
            log("stage", rerun.TextLog(f"reached: {stage}"))
        self._stages = len(monitor.reached)
        log("progress", rerun.Scalars(monitor.progress))
        if self.frames:
            log(f"{CAMERA}/picture", rerun.Image(self.frames[-1]).compress(jpeg_quality=85))
        if (sight := episode.sight()) is not None:
            self._note(sight, episode)

    def write(self, path: Path) -> None:
        """Write the recording of the last rollout; a UsageError if that does not work."""
        with writing(path), replacing(path) as unfinished:
            self._stream.save(unfinished, self._layout())
            self._stream.disconnect()

    def _layout(self) -> Any:
        """The layout shows things from beside the camera, and by them its picture, progress, stages and contacts."""
        view = self._rerun.blueprint
        said = view.TextLogView(contents=["stage", "contacts"], name="stages and contacts")
        beside = [view.Spatial2DView(origin=CAMERA), view.TimeSeriesView(origin="progress"), said]
        if not self._way:
            return view.Blueprint(view.Vertical(*beside), collapse_panels=True)
        eye = view.EyeControls3D(position=self._eye, look_target=self._way[0], eye_up=[0, 0, 1])
        world = view.Spatial3DView(origin="world", eye_controls=eye)
        return view.Blueprint(view.Horizontal(world, view.Vertical(*beside)), collapse_panels=True)

    def _note(self, sight: Sight, episode: Episode) -> None:
        rerun, log = self._rerun, self._stream.log
        forward, left, up = sight.camera.axes
        axes = np.stack([-left, -up, forward], axis=1)  # Rerun's cameras have x to the right, y down, z ahead
        log(CAMERA, rerun.Transform3D(translation=sight.camera.position, mat3x3=axes))
        height, width = self.frames[-1].shape[:2] if self.frames else (1, sight.camera.aspect)
        focus = float(height / (2 * np.tan(np.radians(sight.camera.fov) / 2)))
        log(CAMERA, rerun.Pinhole(focal_length=focus, width=width, height=height, image_plane_distance=0.2))
        if not self._way:
            self._eye = sight.camera.position + BESIDE @ sight.camera.axes
        self._way.append(sight.hand)
        log(HAND, rerun.Points3D([sight.hand], radii=2 * RADIUS))
        log(f"{HAND}/path", rerun.LineStrips3D([self._way], radii=RADIUS))
        for name, (place, turn) in sight.bodies.items():
            body = ["world", name]
            log(body, rerun.Transform3D(translation=place, mat3x3=turn))
            if name not in self._shaped:
                self._shaped.add(name)
                triangles, colour = episode.shape(name)
                sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
                normals = sides / np.maximum(np.linalg.norm(sides, axis=1, keepdims=True), 1e-12)
                mesh = {"vertex_positions": triangles.reshape(-1, 3), "vertex_normals": normals.repeat(3, axis=0)}
                log(body, rerun.Mesh3D(**mesh, albedo_factor=[*colour, 1.0]))
        for contact in sorted(sight.contacts - self._contacts):
            log("contacts", rerun.TextLog(contact))
        self._contacts = sight.contacts
