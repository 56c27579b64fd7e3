"""Makes Blender materials of the folder that this file is in.

    import loden_material
    surface = loden_material.make(towards_sun)

`towards_sun` is the direction from the surface to the distant light that the material is exact for; the mesh needs texture coordinates.
Cycles must use the CPU and Open Shading Language, which `cycles_with_osl` sets.
"""

import importlib.util
import pathlib
import sys

import bpy

FOLDER = pathlib.Path(__file__).resolve().parent


def cycles_with_osl(scene):
    """Renders a scene by Cycles on the CPU, with Open Shading Language."""
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.shading_system = True


def make(towards_sun, repeats=(1, 1), uv_map="", name={NAME}):
    """A material lit exactly from the direction `towards_sun`, repeated so often within texture coordinates 0 to 1."""
    # where bpy is a Python package, what compiles shaders is beside it but not on the path
    if importlib.util.find_spec("oslquery") is None:
        beside = pathlib.Path(bpy.utils.resource_path("LOCAL")).glob("python/lib/python*/site-packages")
        sys.path.extend(str(folder) for folder in beside)
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    shader, output = nodes.new("ShaderNodeScript"), nodes.new("ShaderNodeOutputMaterial")
    shader.mode = "EXTERNAL"
    shader.filepath = str(FOLDER / "material.osl")
    if "BSDF" not in shader.outputs:
        raise RuntimeError(f"Blender cannot compile {shader.filepath}")
    uv, tangent, scale = nodes.new("ShaderNodeUVMap"), nodes.new("ShaderNodeTangent"), nodes.new("ShaderNodeVectorMath")
    tangent.direction_type = "UV_MAP"
    uv.uv_map = tangent.uv_map = uv_map
    scale.operation = "MULTIPLY"
    scale.inputs[1].default_value = (*repeats, 1)
    links.new(uv.outputs[0], scale.inputs[0])
    links.new(scale.outputs[0], shader.inputs["UV"])
    links.new(tangent.outputs[0], shader.inputs["Tangent"])
    links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    shader.inputs["folder"].default_value = str(FOLDER)
    shader.inputs["Light"].default_value = tuple(towards_sun)
    for node, x in ((uv, -600), (tangent, -600), (scale, -400), (shader, -200)):
        node.location.x = x
    tangent.location.y = -200
    return material
