"""Rendering: device, shaders, lights, what is behind everything, and the studio for pictures that people look at."""

import hashlib
import json
import os
import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import sapien
from mani_skill.render.shaders import ShaderConfig
from sapien import physx
from sapien.render import RenderMaterial, RenderTexture2D

from vlafuzz.common import assets
from vlafuzz.common.arrays import Array, Picture
from vlafuzz.model import Backdrop
from vlafuzz.worlds.manipulation.looks import COLOUR, FLOOR_COLOUR, PAINTS, WALL_COLOUR, on_table, planks, shade
from vlafuzz.worlds.manipulation.rigs import PANDA, Lights, Table
from vlafuzz.worlds.tabletop.renderer import rendering_device
from vlafuzz.worlds.tabletop.room import FRICTION

# What SAPIEN's shaders do for nothing: a reflectance table, which takes 6 s to compute on a CPU, light that is mirrored
# from surroundings, of which there are none, and a picture of places and numbers. Without it the pictures are the same.
_NEEDLESS = re.compile(
    r"^layout\(.*\) (uniform sampler2D samplerBRDFLUT|out ivec4 outPositionSegmentation);$"
    r"|^vec3 specularIBL\([^}]*\}$"
    r"|^ *color \+= (diffuse|specular)IBL\([^;]*;$"
    r"|^ *outPositionSegmentation = .*;$",
    re.MULTILINE,
)
# What is opaque needs no background behind it: the same pictures, 6 % sooner.
_COLOUR = "vec4 color = texture(samplerColorRaw, inUV);"
_OPAQUE = f"{_COLOUR}\n  if (color.a == 1) {{ outColor = color; return; }}"
# Reinhard's curve (2002) for light up to 4 times white, so that light × 6 is bright and not a white sheet.
_CLIPPED = "outColorRaw = vec4(clamp("
_CURVED = f"color *= 1.3;\n  color *= (1 + color / 16) / (1 + color);\n  {_CLIPPED}"
_FORMATS = {"Color": "r8g8b8a8unorm", "ColorRaw": "r8g8b8a8unorm"}


def render_system(scene: sapien.Scene) -> sapien.render.RenderSystem | None:
    """The renderer of a scene; None if it only has physics."""
    try:
        return scene.render_system
    except RuntimeError:  # raised by SAPIEN if there is none
        return None


def render_backend() -> str:
    """ManiSkill's name of the rendering device."""
    os.environ.setdefault("LP_NUM_THREADS", "0")  # lavapipe's threads; one worker per core is faster
    return "sapien_cuda" if rendering_device().is_cuda() else "sapien_cpu"


def use_shaders() -> ShaderConfig:
    """Use our shaders for all cameras that are added from now on: SAPIEN keeps them globally."""
    pack = _shader_pack()
    sapien.render.set_camera_shader_dir(str(pack))
    for name, format_ in _FORMATS.items():
        sapien.render.set_picture_format(name, format_)
    return ShaderConfig(
        shader_pack=str(pack),
        texture_names={"Color": ["rgb"]},
        texture_transforms={"Color": lambda data: {"rgb": data[..., :3]}},
    )


@cache
def _shader_pack(*, full: bool = False) -> Path:
    """SAPIEN's fastest shader pack without needless work, in the user's cache; ``full`` with a tone curve."""
    source = Path(sapien.__file__).parent / "vulkan_shader"
    shaders = {
        f"{name}/{file.name}": _quick(file.read_text(encoding="utf-8")).replace(_CLIPPED, _CURVED if full else _CLIPPED)
        for name in ("minimal", "common")
        for file in sorted((source / name).iterdir())
    }

    def fill(folder: Path) -> None:
        for name, text in shaders.items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")

    digest = hashlib.sha256(json.dumps(shaders).encode()).hexdigest()[:20]
    folder = assets.made_once(f"shaders/{digest}", fill, lambda made: all((made / name).is_file() for name in shaders))
    return folder / "minimal"


def _quick(shader: str) -> str:
    """The shader without needless work; unchanged where SAPIEN has changed it, which is only slower."""
    without = _NEEDLESS.sub("", shader)
    left = re.search("samplerBRDFLUT|specularIBL|outPositionSegmentation", without)
    return (shader if left else without).replace(_COLOUR, _OPAQUE)


def add_entity(scene: sapien.Scene, name: str, pose: sapien.Pose, *components: sapien.Component) -> sapien.Entity:
    """Add an entity of these components."""
    entity = sapien.Entity()
    entity.name, entity.pose = name, pose
    for component in components:
        entity.add_component(component)
    scene.add_entity(entity)
    return entity


class SceneLights:
    """Ambient and directional lights, of which the first may cast shadows, 1 m around the origin.

    Their entities move with the others into each new PhysX scene.
    """

    def __init__(self, scene: sapien.Scene, nominal: Lights, *, shadows: bool = False) -> None:
        self._nominal = nominal
        self._lights: list[sapien.render.RenderDirectionalLightComponent] = []
        for direction, intensity in nominal.directional:
            light = sapien.render.RenderDirectionalLightComponent()
            light.color = [intensity] * 3
            light.disable_shadow()
            pose = _looking_along(direction)
            if shadows and not self._lights:  # SAPIEN reads this when the light is added
                light.enable_shadow()
                light.shadow_map_size, light.shadow_half_size = 1024, 1.0
                light.shadow_near, light.shadow_far = 0.1, 6.0
                pose = sapien.Pose(-2 * np.array(direction), pose.q)
            add_entity(scene, "light", pose, light)
            self._lights.append(light)

    def apply(self, scene: sapien.Scene, intensity: float) -> None:
        """Scale all lights including the ambient one."""
        scene.render_system.ambient_light = [self._nominal.ambient * intensity] * 3
        for light, (_, nominal) in zip(self._lights, self._nominal.directional, strict=True):
            light.color = [nominal * intensity] * 3

    def measure(self, scene: sapien.Scene) -> float:
        """The factor on the nominal lights, read back; ValueError if they are not scaled by one factor."""
        factors = [float(scene.render_system.ambient_light[0]) / self._nominal.ambient]
        factors += [
            float(light.color[0]) / nominal
            for light, (_, nominal) in zip(self._lights, self._nominal.directional, strict=True)
        ]
        if max(factors) - min(factors) > 1e-4 * max(factors):
            raise ValueError(f"lights scaled by {factors}")
        return factors[0]


def _looking_along(direction: tuple[float, float, float]) -> sapien.Pose:
    forward = np.array(direction) / np.linalg.norm(direction)
    side = np.cross([0.0, 1.0, 0.0] if abs(forward[1]) < 0.9 else [1.0, 0.0, 0.0], forward)
    side /= np.linalg.norm(side)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([forward, np.cross(forward, -side), side], axis=1)
    return sapien.Pose(matrix)


def add_table(scene: sapien.Scene, size: Table) -> sapien.Entity:
    """Add a static box; if the scene can render, a visible one with floor and wall."""
    body = physx.PhysxRigidStaticComponent()
    body.attach(physx.PhysxCollisionShapeBox(list(size.half), physx.PhysxMaterial(FRICTION, FRICTION, 0.0)))
    rendered = render_system(scene) is not None
    top = [_box(size.half, _painted(_shaded(COLOUR, planks())))] if rendered else []
    table = add_entity(scene, "table", sapien.Pose([*size.centre, -size.half[2]]), body, *top)
    if rendered:  # after the table: what it hides need not be shaded
        plain = RenderMaterial(base_color=[*WALL_COLOUR, 1.0], roughness=0.9, specular=0.0)
        for name, half, material, place in (
            ("wall", (0.01, 3.0, 2.0), plain, (size.wall, 0.0, size.floor + 2.0)),
            ("floor", (3.0, 3.0, 0.01), _painted(_tiles()), (0.0, 0.0, size.floor)),
        ):
            add_entity(scene, name, sapien.Pose(place), _box(half, material))
    return table


def _box(half: tuple[float, float, float], material: RenderMaterial) -> sapien.render.RenderBodyComponent:
    visual = sapien.render.RenderBodyComponent()
    visual.attach(sapien.render.RenderShapeBox(list(half), material))
    return visual


def _painted(texture: RenderTexture2D) -> RenderMaterial:
    material = RenderMaterial(base_color=[1.0, 1.0, 1.0, 1.0], roughness=0.8, specular=0.1)
    material.base_color_texture = texture
    return material


def _texture(colours: Array) -> RenderTexture2D:
    """A texture of linear colours ``(height, width, 3)``, rounded as in an image of sRGB."""
    srgb = np.round(np.clip(colours, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)
    linear = (srgb / 255.0) ** 2.2
    opaque = np.concatenate([linear, np.ones((*linear.shape[:2], 1))], axis=2)
    return RenderTexture2D(np.round(opaque * 255).astype(np.uint8), "R8G8B8A8Unorm", mipmap_levels=6)


def _shaded(colour: Sequence[float], shade: Array) -> RenderTexture2D:
    """Shades of a colour that is their mean, linear like all colours of the catalogue."""
    return _texture(np.array(colour) * (shade / shade.mean())[..., None])


def _tiles(size: int = 128) -> RenderTexture2D:
    cells = size // 8
    shade = 1.0 + np.random.default_rng(5).normal(0, 0.04, (8, 8)).repeat(cells, axis=0).repeat(cells, axis=1)
    joint = np.arange(size) % cells < 1
    shade[joint], shade[:, joint] = 0.75, 0.75
    return _texture(np.array(FLOOR_COLOUR) * shade[..., None])


class BackdropPainter:
    """Paints one table and its wall, which are nominal at first. Without a renderer it paints nothing."""

    def __init__(self, scene: sapien.Scene) -> None:
        self.backdrop = Backdrop()
        self._materials: list[RenderMaterial] = []
        if render_system(scene) is not None:
            entities = {entity.name: entity for entity in scene.entities}
            for name in ("table", "wall"):
                body = entities[name].find_component_by_type(sapien.render.RenderBodyComponent)
                self._materials.append(body.render_shapes[0].material)
            self._textures = {("planks", "oak"): self._materials[0].base_color_texture}

    def paint(self, backdrop: Backdrop) -> None:
        """Show a backdrop."""
        if self._materials and backdrop != self.backdrop:
            table, wall = self._materials
            look = backdrop.table, backdrop.colour
            if look not in self._textures:
                self._textures[look] = _shaded(PAINTS[backdrop.colour], shade(backdrop.table))
            table.base_color_texture = self._textures[look]
            wall.base_color = [*PAINTS[backdrop.wall], 1.0]
        self.backdrop = backdrop


# A key light from the front left, and a weak one against it. With the tone curve, as bright as the Panda's own lights.
STUDIO_LIGHTS = Lights(ambient=0.2, directional=(((-0.45, 0.5, -1.0), 1.0), ((-0.6, -0.5, -1.0), 0.25)))
FINER = 2  # pixels of a side that are averaged to one: smooth edges


class Studio:
    """A twin of what a camera of a scene shows, under lights that cast shadows, for pictures that people look at.

    They are as bright as the robot's own lights, ``usual``. The simulated scene, its lights and its camera are left as
    they are, so what policies see does not change.
    """

    def __init__(self, device: sapien.Device, camera: sapien.render.RenderCameraComponent, usual: Lights) -> None:
        self._scene = sapien.Scene([sapien.render.RenderSystem(device)])
        self._lights = SceneLights(self._scene, STUDIO_LIGHTS, shadows=True)
        self._usual = on_table(usual) / on_table(PANDA.lights)
        use_shaders()
        sapien.render.set_camera_shader_dir(str(_shader_pack(full=True)))
        twin = sapien.render.RenderCameraComponent(FINER * camera.width, FINER * camera.height)
        across, down, u, v = (FINER * length for length in (camera.fx, camera.fy, camera.cx, camera.cy))
        twin.set_perspective_parameters(camera.near, camera.far, across, down, u, v, 0.0)
        add_entity(self._scene, "", sapien.Pose(), twin)
        self._followed, self._camera = camera, twin
        self._twins: list[tuple[sapien.Entity, sapien.Entity]] = []

    def begin(self, scene: sapien.Scene, light: float) -> None:
        """Show what is visible in a scene, under light × ``light``."""
        for _, twin in self._twins:
            self._scene.remove_entity(twin)
        self._twins = []
        for entity in scene.entities:
            visual = entity.find_component_by_type(sapien.render.RenderBodyComponent)
            if visual is not None:
                self._twins.append((entity, add_entity(self._scene, "", sapien.Pose(), visual.clone())))
        self.light(light)

    def light(self, intensity: float) -> None:
        self._lights.apply(self._scene, self._usual * intensity)

    def picture(self) -> Picture:
        """``(height, width, 3)``: what the camera shows at present."""
        for entity, twin in self._twins:
            twin.pose = entity.pose
        self._camera.entity.pose = self._followed.get_global_pose()
        self._scene.update_render()
        self._camera.take_picture()
        image = self._camera.get_picture("Color")[..., :3]
        size = (self._followed.width, self._followed.height)
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
