"""Chooses a variant of Mitsuba that works on this machine."""

import subprocess
import sys

import mitsuba as mi

# Compiles a kernel with a mesh, several bounces and gathers: an LLVM that does not know the processor aborts the process here.
PROBE = """
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
scene = mi.cornell_box()
scene["sensor"]["film"]["width"] = scene["sensor"]["film"]["height"] = 8
mi.render(mi.load_dict(scene), spp=4).numpy()
"""


def choose():
    """Sets `llvm_ad_rgb` if a child process can render with it, else `scalar_rgb`, and returns which one it is."""
    found = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True)
    variant = "scalar_rgb" if found.returncode else "llvm_ad_rgb"
    mi.set_variant(variant)
    why = "" if found.returncode == 0 else f" (llvm_ad_rgb ended with {found.returncode}: {reason(found.stderr)})"
    print(f"Mitsuba {mi.__version__}, variant {variant}{why}")
    return variant


def reason(text):
    """The last line that a failed process wrote."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:120] if lines else "nothing on standard error"
