"""What comparisons of exported materials share."""

import subprocess

import numpy as np


def methods(program):
    """The names of all compression methods."""
    listed = subprocess.run([program, "compress", "--help"], check=True, capture_output=True, text=True).stdout
    section = listed.split("--method <METHOD>")[1].split("[default:")[0]
    found = [line.strip()[2:].split(":")[0] for line in section.splitlines() if line.strip().startswith("- ")]
    assert len(found) >= 11, found
    return found


# parameters of methods that take long by default
QUICK = {"neural": ["--samples", "0.05", "--width", "8"], "cmf": ["--clusters", "8"]}


def random_points(count, seed):
    """Directions of light and viewer (polar angle and azimuth in degrees), and texture coordinates."""
    random = np.random.default_rng(seed)
    angles = [np.degrees(np.arccos(random.uniform(0.02, 1, count))) if k % 2 == 0 else random.uniform(0, 360, count) for k in range(4)]
    return np.stack(angles + [random.uniform(-1, 2, count), random.uniform(-1, 2, count)], -1).astype(np.float32)


# An anisotropic BRDF, as the command line names it
WARD = "ward:alpha-x=0.2:alpha-y=0.5:kd=0.2,0.1,0.05:ks=0.2"


def apparent_of_ward(program, folder, points):
    """Pi times the BRDF times the cosine of the light, of WARD."""
    return np.pi * np.cos(np.radians(points[:, :1].astype(np.float64))) * values_of(program, folder, WARD, points)


def values_of(program, folder, material, points):
    """What `loden eval` gives for a material of this folder at these points."""
    np.savetxt(folder / "queries.csv", points, delimiter=",", fmt="%.9g")
    material = folder / material if (folder / material).exists() else material
    command = [program, "eval", material, "--queries", folder / "queries.csv", "-o", folder / "values.csv", "--force", "-q"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    values = np.genfromtxt(folder / "values.csv", delimiter=",", skip_header=1)[:, -3:]
    assert len(values) == len(points) and values.mean() > 0.01, values
    return values
