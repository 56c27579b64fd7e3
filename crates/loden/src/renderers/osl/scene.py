"""Renders a ball that wears the material: python scene.py [PICTURE.exr], with bpy installed, or blender -b -P scene.py -- [PICTURE.exr]."""

import math
import pathlib
import sys

import bpy
from mathutils import Vector

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
import loden_material  # noqa: E402


def ball(around=256):
    """A mesh of radius 1 with texture coordinates: u twice around the z axis, v from pole to pole."""
    rows, columns = around // 2, around
    corner = [(row, column) for row in range(rows + 1) for column in range(columns + 1)]
    angles = [(math.pi * row / rows, 2 * math.pi * column / columns) for row, column in corner]
    points = [(math.sin(down) * math.cos(turn), math.sin(down) * math.sin(turn), math.cos(down)) for down, turn in angles]
    quads = [(row * (columns + 1) + column, (row + 1) * (columns + 1) + column) for row in range(rows) for column in range(columns)]
    faces = [(a, b, b + 1, a + 1) for a, b in quads]
    mesh = bpy.data.meshes.new("ball")
    mesh.from_pydata(points, [], faces)
    mesh.polygons.foreach_set("use_smooth", [True] * len(faces))
    layer = mesh.uv_layers.new(name="uv")
    uvs = [(turn / math.pi, 1 - down / math.pi) for down, turn in angles]
    layer.data.foreach_set("uv", [number for loop in mesh.loops for number in uvs[loop.vertex_index]])
    # the seam has two vertices at each place: their normals are those of the sphere all the same
    mesh.normals_split_custom_set_from_vertices(points)
    return bpy.data.objects.new("ball", mesh)


def render(picture, to_light={TO_LIGHT}, side={SIDE}, samples=16):
    """Writes the test scene, an EXR file in linear light."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    loden_material.cycles_with_osl(scene)
    towards = Vector(to_light).normalized()
    thing = ball()
    thing.data.materials.append(loden_material.make(towards, repeats=({REPEATS}, {REPEATS})))
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle = {IRRADIANCE}, 0
    light = bpy.data.objects.new("sun", sun)
    light.rotation_euler = towards.to_track_quat("Z", "Y").to_euler()
    lens = bpy.data.cameras.new("camera")
    lens.angle = math.radians({FIELD_OF_VIEW})
    camera = bpy.data.objects.new("camera", lens)
    camera.location = {EYE}
    camera.rotation_euler = Vector({EYE}).to_track_quat("Z", "Y").to_euler()
    for new in (thing, light, camera):
        scene.collection.objects.link(new)
    scene.camera = camera
    world = bpy.data.worlds.new("dark")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    scene.world = world
    scene.cycles.samples, scene.cycles.max_bounces = samples, 0
    scene.cycles.use_denoising = scene.cycles.use_adaptive_sampling = False
    # with one light, choosing among lights only adds noise
    scene.cycles.use_light_tree = False
    scene.cycles.pixel_filter_type = "BOX"
    scene.render.resolution_x = scene.render.resolution_y = side
    scene.render.filepath = str(pathlib.Path(picture).resolve())
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    given = sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else sys.argv[1:]
    name = given[0] if given else "ball.exr"
    render(name)
    print(f"wrote {name}")
