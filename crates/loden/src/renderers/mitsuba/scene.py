"""Renders a ball that wears the material: python scene.py [PICTURE.exr [VARIANT]]."""

import pathlib
import sys

import mitsuba as mi

picture = sys.argv[1] if len(sys.argv) > 1 else "ball.exr"
mi.set_variant(sys.argv[2] if len(sys.argv) > 2 else "llvm_ad_rgb")
folder = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(folder))
import loden_btf  # noqa: E402, F401

look = mi.ScalarTransform4f().look_at(origin={EYE}, target=[0, 0, 0], up=[0, 0, 1])
scene = mi.load_dict({
    "type": "scene",
    "integrator": {"type": "path", "max_depth": 2},
    "sensor": {
        "type": "perspective",
        "fov": {FIELD_OF_VIEW},
        "to_world": look,
        "film": {"type": "hdrfilm", "width": {SIDE}, "height": {SIDE}, "rfilter": {"type": "box"}},
        "sampler": {"type": "independent", "sample_count": 16},
    },
    "light": {"type": "directional", "direction": {FROM_LIGHT}, "irradiance": {IRRADIANCE}},
    "ball": {
        "type": "sphere",
        "bsdf": {
            "type": "loden_btf",
            "folder": str(folder),
            "to_uv": mi.ScalarTransform4f().scale([{TWICE_REPEATS}, -{REPEATS}, 1]),
        },
    },
})
mi.util.write_bitmap(picture, mi.render(scene))
print(f"wrote {picture}")
