"""Chooses a variant of Mitsuba that works on this machine."""

import glob
import os
import re
import subprocess
import sys

import mitsuba as mi

# Compiles a kernel with a mesh, several bounces and gathers: an LLVM too old for the processor aborts the process here.
PROBE = """
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
scene = mi.cornell_box()
scene["sensor"]["film"]["width"] = scene["sensor"]["film"]["height"] = 8
mi.render(mi.load_dict(scene), spp=4).numpy()
"""


def libraries():
    """The LLVM libraries of this machine, newest first; `DRJIT_LIBLLVM_PATH` alone if it is set."""
    if "DRJIT_LIBLLVM_PATH" in os.environ:
        return [os.environ["DRJIT_LIBLLVM_PATH"]]
    found = {os.path.realpath(path) for path in glob.glob("/usr/lib/*/libLLVM*.so*") + glob.glob("/usr/lib/llvm-*/lib/libLLVM*.so*")}
    version = lambda path: [int(number) for number in re.findall(r"\d+", os.path.basename(path))]
    return sorted(found, key=version, reverse=True)


def choose():
    """Sets `llvm_ad_rgb` if a child process can render with it, else `scalar_rgb`, and returns which one it is."""
    tried = []
    for library in libraries():
        environment = {**os.environ, "DRJIT_LIBLLVM_PATH": library}
        if subprocess.run([sys.executable, "-c", PROBE], env=environment, capture_output=True).returncode == 0:
            os.environ["DRJIT_LIBLLVM_PATH"] = library
            return chosen("llvm_ad_rgb", f"with {os.path.basename(library)}")
        tried.append(os.path.basename(library))
    return chosen("scalar_rgb", f"{', '.join(tried)} cannot render here" if tried else "there is no LLVM")


def chosen(variant, why):
    """Sets a variant and says so."""
    mi.set_variant(variant)
    print(f"Mitsuba {mi.__version__}, variant {variant}: {why}")
    return variant
