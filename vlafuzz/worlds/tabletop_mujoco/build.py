"""A scene of the tabletop as a MuJoCo model: the same meshes, masses, friction, gains, camera and colours as there."""

import re
from collections.abc import Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import trimesh

from vlafuzz.common.arrays import Array, Picture
from vlafuzz.common.assets import operators_dir
from vlafuzz.model import Backdrop, Placement
from vlafuzz.worlds.manipulation.looks import FLOOR_COLOUR, GAMMA, PAINTS, Colour, lamps_of, shade, shown
from vlafuzz.worlds.manipulation.rigs import PANDA, Lights
from vlafuzz.worlds.manipulation.rotations import quaternion, rotation_matrix
from vlafuzz.worlds.tabletop.fairness.footprint import pose_of
from vlafuzz.worlds.tabletop.fairness.visible import textured
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.room import DAMPING, FRICTION, ROLLING_DAMPING, WRIST_CAMERA

STEP = 0.002  # seconds of a physics step, MuJoCo's own; PhysX has 0.01 with 15 iterations in each
STIFFNESS, RESISTANCE, FORCE = PANDA.gains["panda_joint1"]  # as all joints have
# Kilograms of the drives. Contacts in MuJoCo are as stiff as bodies are heavy: without it, fingers of 15 g sink 2 mm
# into what they hold, and cubes creep out of them.
ARMATURE = 0.1
# PhysX takes the mean of two materials, MuJoCo the larger one: of pads with 2.0 and things with 0.6 both get 1.3.
LINK_FRICTION, PAD_FRICTION = 0.3, 1.3
PATCH = 0.1  # metres: radius of the pads' torsional friction
CONVEX = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
ROBOT, THING = 1, 2  # kinds of shapes: the robot's do not collide with each other
LOOKS, SHAPES = 0, 3  # groups: what pictures show, and what collides
FINGERS = ("panda_leftfinger", "panda_rightfinger")
TCP = "panda_hand_tcp"
CAMERA, WRIST = "view", "wrist"
_read_textured = lru_cache(maxsize=64)(textured)
_VISUAL = re.compile(r"<visual>.*?</visual>", re.DOTALL)
_FILE = re.compile(r'<link name="(\w+)">\s*<visual>(.*?)<geometry>\s*<mesh filename="([^"]+)"', re.DOTALL)


@cache
def robot() -> Any:
    """The Panda with table, wall, floor and lights as an ``MjSpec``, to which things are added."""
    file = operators_dir() / "robots" / "panda" / "panda_v2.urdf"
    text = file.read_text(encoding="utf-8")
    flags = " ".join(f'{name}="false"' for name in ("strippath", "fusestatic", "discardvisual"))
    options = f'<mujoco><compiler {flags} meshdir="{file.parent}"/></mujoco>'
    spec = mujoco.MjSpec.from_string(
        _VISUAL.sub("", text).replace('<robot name="panda">', f'<robot name="panda">{options}')
    )
    spec.option.timestep = STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0  # with these iterations things do not creep out of the fingers
    spec.option.noslip_iterations = 3
    spec.visual.headlight.active = 0
    spec.stat.extent = 1.0  # metres, of which the nearest and farthest that a camera shows are multiples
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 10.0
    spec.body("panda_link0").pos = PANDA.base
    for body in spec.bodies[1:]:
        body.gravcomp = 1.0
    for geom in spec.geoms:
        on_pad = geom.parent.name in FINGERS
        friction = PAD_FRICTION if on_pad else LINK_FRICTION
        _solid(geom, ROBOT, [friction, PATCH * friction if on_pad else 0.005, 0.0001])
    for joint in spec.joints:
        joint.damping, joint.frictionloss, joint.armature = np.zeros(3), 0.0, ARMATURE
        drive = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        drive.set_to_position(kp=STIFFNESS, kv=RESISTANCE)
        drive.forcelimited, drive.forcerange = True, [-FORCE, FORCE]
    for link, turn, name in _FILE.findall(text):
        _dress(spec, spec.body(link), file.parent / name, half_turn="3.14159" in turn)
    size = PANDA.table
    table = spec.worldbody.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, size=size.half)
    table.pos = [*size.centre, -size.half[2]]
    _solid(table, THING, [FRICTION, 0.005, 0.0001])
    for name, half, place in (
        ("top", size.half, table.pos),
        ("wall", (0.01, 3.0, 2.0), (size.wall, 0.0, size.floor + 2.0)),
        ("floor", (3.0, 3.0, 0.01), (0.0, 0.0, size.floor)),
    ):
        spec.add_material(name=name)
        _seen(spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=half, pos=place, material=name))
    spec.material("floor").rgba = [*_srgb(FLOOR_COLOUR), 1.0]
    ambient, shares = lamps(PANDA.lights)
    for number, ((direction, _), share) in enumerate(zip(PANDA.lights.directional, shares, strict=True)):
        lamp = spec.worldbody.add_light(dir=direction, type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, castshadow=False)
        lamp.ambient, lamp.diffuse, lamp.specular = [ambient if number == 0 else 0.0] * 3, [share] * 3, [0.0] * 3
    spec.worldbody.add_camera(name=CAMERA, fovy=PANDA.view.fov)
    place, turn = WRIST_CAMERA
    axes = np.array(rotation_matrix(turn)).T  # forward, left, up
    spec.body("panda_hand").add_camera(name=WRIST, pos=place, quat=looking(axes), fovy=90.0)
    return spec


def compiled(models: Sequence[ObjectModel], placements: Sequence[Placement], backdrop: Backdrop) -> Any:
    """The model of a scene; its things are the last bodies, in their order, at their poses."""
    spec = robot().copy()
    _paint(spec, "top", _table(backdrop.table, PAINTS[backdrop.colour]))
    spec.material("wall").rgba = [*_srgb(PAINTS[backdrop.wall]), 1.0]
    for number, (model, placement) in enumerate(zip(models, placements, strict=True)):
        turn, place = pose_of(placement, model)
        body = spec.worldbody.add_body(name=str(number), pos=place, quat=quaternion(turn))
        body.add_freejoint()
        for part, file in enumerate(model.collision):
            name = f"{number}.{part}"
            spec.add_mesh(name=name, file=str(file), scale=[placement.scale] * 3, inertia=CONVEX)
            shape = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, density=model.density)
            _solid(shape, THING, [model.friction, 0.005, 0.0001])
        _wrap(spec, body, model, placement.scale)
    built = spec.compile()
    for number, model in enumerate(models):
        body = built.body(str(number))
        spin = ROLLING_DAMPING if any(pose.rolls for pose in model.stable_poses) else DAMPING
        start = int(built.body_dofadr[body.id])
        built.dof_damping[start + 3 : start + 6] = spin * float(body.inertia.mean())
    return built


def looking(axes: Array) -> Array:
    """``(4,)`` the quaternion of a camera with rows forward, left and up: MuJoCo's look along -z, with y up."""
    forward, left, up = axes
    return quaternion(np.stack([-left, up, -forward], axis=1))


def _solid(geom: Any, kind: int, friction: list[float]) -> None:
    geom.friction, geom.condim, geom.group = friction, 4, SHAPES
    geom.contype, geom.conaffinity = kind, 0 if kind == ROBOT else ROBOT | THING
    # As stiff as the step allows. At a damping ratio of 1, fingers bounce off cans, which sink by 1.6 mm a second.
    geom.solref, geom.solimp = [2 * STEP, 2.0], [0.99, 0.999, 0.001, 0.5, 2.0]


def _seen(geom: Any) -> None:
    geom.contype = geom.conaffinity = 0
    geom.group, geom.density = LOOKS, 0.0


def _dress(spec: Any, body: Any, file: Path, *, half_turn: bool) -> None:
    """Show a link's visual mesh, each part in its colour."""
    meshes: Any = trimesh.load_scene(file).dump()
    for number, mesh in enumerate(meshes):
        name = f"{body.name}.{number}"
        vertices = mesh.vertices * [-1, -1, 1] if half_turn else mesh.vertices
        _mesh(spec, name, vertices, mesh.faces)
        colour = mesh.visual.material.baseColorFactor
        linear = np.array([1.0, 1.0, 1.0] if colour is None else colour[:3] / 255)
        spec.add_material(name=name, rgba=[*_srgb(linear), 1.0])
        _seen(body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name))


def _wrap(spec: Any, body: Any, model: ObjectModel, scale: float) -> None:
    """Show a thing: its textured mesh; of a pack, its convex parts in their mean colour."""
    if model.fit is None and model.visual.suffix == ".glb":
        name, (mesh, texture) = f"{body.name}.look", _read_textured(model.visual)
        _mesh(spec, name, mesh.vertices * scale, mesh.faces, mesh.visual.uv)
        spec.add_material(name=name)
        _paint(spec, name, texture)
        _seen(body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=name))
        return
    for part in range(len(model.collision)):
        _seen(body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"{body.name}.{part}", rgba=[*model.colour, 1.0]))


def _mesh(spec: Any, name: str, vertices: Array, faces: Any, uv: Any = None) -> None:
    mesh = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    mesh.uservert, mesh.userface = vertices.ravel().tolist(), np.asarray(faces).ravel().tolist()
    if uv is not None:
        mesh.usertexcoord = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1).ravel().tolist()


@lru_cache(maxsize=64)
def _table(pattern: str, colour: Colour) -> Picture:
    shades = shade(pattern)
    linear = np.array(colour) * (shades / shades.mean())[..., None]
    pixels: Picture = np.round(np.clip(linear, 0, 1) ** (1 / GAMMA) * 255).astype(np.uint8)
    return pixels


def _paint(spec: Any, material: str, pixels: Picture) -> None:
    height, width = pixels.shape[:2]
    texture = spec.add_texture(
        name=material, type=mujoco.mjtTexture.mjTEXTURE_2D, height=height, width=width, nchannel=3
    )
    texture.data = pixels.tobytes()
    textures = spec.material(material).textures
    textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = material
    spec.material(material).textures = textures


def _srgb(colour: Colour | Array) -> list[float]:
    return [float(share) ** (1 / GAMMA) for share in colour]


@cache
def lamps(lights: Lights) -> tuple[float, list[float]]:
    """Ambient light and shares of the lamps by which MuJoCo, which adds sRGB, shows surfaces most as SAPIEN does."""
    normals = np.random.default_rng(0).normal(size=(2000, 3))
    normals[:, 2] = np.abs(normals[:, 2])  # of those that a camera above can see
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cosines = np.maximum(normals @ lamps_of(lights)[0].T, 0.0)
    wanted = shown(np.ones((len(normals), 1)), normals, lights, 1.0)[:, 0] / 255
    found, *_ = np.linalg.lstsq(np.column_stack([np.ones(len(normals)), cosines]), wanted, rcond=None)
    ambient, *shares = found.tolist()
    return ambient, shares
