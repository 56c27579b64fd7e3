"""A measured material (BTF) as a BSDF of Mitsuba 3, written by loden.

    import mitsuba as mi
    mi.set_variant("llvm_ad_rgb")
    import loden_btf                      # registers the BSDF
    bsdf = mi.load_dict({"type": "loden_btf", "folder": "."})

Parameters: `folder`, where material.json lies; `to_uv`, a transform of texture coordinates; `scale`, a factor of all
values. Values are linear RGB. The surface needs texture coordinates: the material is turned by their directions, u to
the right and v upwards in the photographs. Only the front is visible.
"""

import json
import math
import pathlib

import drjit as dr
import mitsuba as mi
import numpy as np

# Rings and sectors of the histograms that directions are drawn from, and the share of the cosine distribution
RINGS, SECTORS, COSINE_SHARE = 18, 36, 0.1
EPSILON = 1e-5


class Array:
    """Numbers of one type, read by index. Scalar variants of Mitsuba index one number at a time."""

    def __init__(self, values):
        values = np.ascontiguousarray(values)
        if values.size >= 2**32:
            raise ValueError(f"{values.size} numbers are more than Dr.Jit can index")
        self.scalar = mi.Float is float
        whole = np.issubdtype(values.dtype, np.integer)
        if self.scalar:
            self.values = values.reshape(-1)
            self.number = int if whole else float
        else:
            self.number = mi.UInt32 if whole else mi.Float
            self.values = self.number(values.reshape(-1).astype(np.uint32 if whole else np.float32))
            dr.eval(self.values)

    def __getitem__(self, index):
        if self.scalar:
            return self.number(self.values[int(index)])
        return dr.gather(self.number, self.values, mi.UInt32(index))

    def four(self, index):
        """Four numbers in a row, the first at 4 x index."""
        if self.scalar:
            return [float(v) for v in self.values[4 * int(index) : 4 * int(index) + 4]]
        return dr.gather(mi.Vector4f, self.values, mi.UInt32(index))


class Directions:
    """Interpolation between sampled directions: barycentric in a triangulation of the hemisphere."""

    def __init__(self, folder, kind, triangles):
        load = lambda name: np.load(folder / f"{kind}-{name}.npy")
        start = load("start")
        self.side, self.triangles = start.shape[0], triangles
        self.start, self.corners = Array(start), Array(load("corners"))
        self.neighbours, self.matrix = Array(load("neighbours")), Array(load("matrix"))
        self.cells, self.cosines = len(load("corners")), Array(load("cosines"))

    def weights(self, cell, w):
        row = lambda k: sum(self.matrix[9 * cell + 3 * k + j] * w[j] for j in range(3))
        return row(0), row(1), row(2)

    def find(self, w):
        """The indices and weights of three samples, and the fade below the lowest."""
        half = (self.side - 1) / 2
        square = lambda x: mi.UInt32(dr.clip(dr.round(x * half + half), 0, self.side - 1))
        cell = self.start[square(w.y) * self.side + square(w.x)]

        def outside(cell, steps):
            a, b, c = self.weights(cell, w)
            return (dr.minimum(a, dr.minimum(b, c)) < -1e-6) & (steps < self.cells)

        def step(cell, steps):
            a, b, c = self.weights(cell, w)
            lowest = dr.select(a < b, dr.select(a < c, mi.UInt32(0), mi.UInt32(2)), dr.select(b < c, mi.UInt32(1), mi.UInt32(2)))
            beyond = self.neighbours[3 * cell + lowest]
            return mi.UInt32(dr.select(beyond < self.cells, beyond, cell)), steps + 1

        if mi.Float is float:
            steps = 0
            while outside(cell, steps):
                cell, steps = step(cell, steps)
        else:
            cell, _ = dr.while_loop((cell, mi.UInt32(0)), outside, step)
        corners = [self.corners[3 * cell + k] for k in range(3)]
        a, b, c = (dr.maximum(weight, 0) for weight in self.weights(cell, w))
        total = a + b + c
        # a sector below the measured region: the values of its edge
        triangle = cell < self.triangles
        along = b / dr.maximum(a + b, 1e-30)
        edge = (1 - along) * self.cosines[corners[0]] + along * self.cosines[corners[1]]
        fade = dr.select(edge > 1e-6, dr.clip(w.z / dr.maximum(edge, 1e-6), 0, 1), 1)
        weights = [
            dr.select(triangle, a / total, 1 - along),
            dr.select(triangle, b / total, along),
            dr.select(triangle, c / total, 0),
        ]
        return list(zip(corners, weights)), dr.select(triangle, 1, fade)


def unscaled(numbers, axes, ranges, range_axes):
    """Numbers for which offsets and scales are stored: offset + scale x number."""
    order = [axis for axis in range_axes if axis != "range"]
    ranges = np.moveaxis(ranges.astype(np.float32), range_axes.index("range"), -1)
    shape = [numbers.shape[k] if axis in order else 1 for k, axis in enumerate(axes)]
    ranges = ranges.transpose([order.index(axis) for axis in axes if axis in order] + [ranges.ndim - 1])
    offset, scale = (ranges[..., k].reshape(shape) for k in range(2))
    return offset + scale * numbers.astype(np.float32)


def named(axis):
    """An axis without its length."""
    return axis if isinstance(axis, str) else next(iter(axis))


class Material:
    """The planes and tables of a compressed BTF, and its recipe."""

    def __init__(self, folder):
        folder = pathlib.Path(folder)
        description = json.loads((folder / "material.json").read_text())
        self.recipe = description["recipe"]
        self.btf = description["btf"]
        self.is_linear = description["blending"] == "linear"
        self.width, self.height = self.btf["width"], self.btf["height"]
        self.views = Directions(folder, "views", description["views"]["triangles"])
        self.lights = Directions(folder, "lights", description["lights"]["triangles"])
        self.view_count, self.light_count = description["views"]["count"], description["lights"]["count"]
        stored = {spec["name"]: np.load(folder / f"table-{spec['name']}.npy") for spec in self.recipe["tables"]}
        self.tables = [self.table_of(spec, stored) for spec in self.recipe["tables"]]
        self.planes = [self.plane_of(folder, spec, stored) for spec in self.recipe["planes"]]
        index = np.load(folder / "lobes-index.npy")
        self.lobe_rows, self.lobe_columns = index.shape
        self.lobe_index = Array(index)
        self.cumulated = Array(np.load(folder / "lobes-cumulated.npy"))

    def ranges(self, number, stored):
        spec = self.recipe["tables"][number]
        return stored[spec["name"]], [named(axis) for axis in spec["axes"]]

    def table_of(self, spec, stored):
        """A table with the axes row, view, light, grid, component, channel; those that it lacks have length 1."""
        values, axes = stored[spec["name"]], [named(axis) for axis in spec["axes"]]
        if spec.get("range") is not None:
            values = unscaled(values, axes, *self.ranges(spec["range"], stored))
        if "range" in axes:
            return None
        for axis in [axis for axis in axes if axis == "shared"]:
            values, axes = values.take(0, axes.index(axis)), [a for a in axes if a != axis]
        on_grid = next((axis for axis in axes if axis in ("half", "difference")), None)
        axes = ["grid" if axis == on_grid else axis for axis in axes]
        order = ["row", "view", "light", "grid", "component", "channel"]
        values = values.transpose([axes.index(axis) for axis in order if axis in axes])
        values = values.reshape([values.shape[[a for a in order if a in axes].index(axis)] if axis in axes else 1 for axis in order])
        values = np.repeat(values, 3, -1) if "channel" not in axes else values
        shape = values.shape
        packed = np.zeros(shape[:-1] + (4,), np.float32)
        packed[..., :3] = values
        side = math.isqrt(shape[3]) if on_grid else None
        return {"values": Array(packed), "shape": shape, "side": side, "on_grid": on_grid}

    def plane_of(self, folder, spec, stored):
        """A plane with the axes view, texel, number; numbers are padded to groups of four."""
        values = np.load(folder / f"plane-{spec['name']}.npy")
        kind = spec["kind"]
        if "index" in kind:
            return {"values": Array(values.reshape(-1).astype(np.uint32))}
        kind = kind["numbers"]
        per_view = kind["views"] == "each"
        values = values if per_view else values[None]
        if kind.get("range") is not None:
            ranges, axes = self.ranges(kind["range"], stored)
            axes = ["view" if axis == "shared" else axis for axis in axes]
            values = unscaled(values, ["view", "y", "x", "component"], ranges, axes)
        groups = -(-kind["count"] // 4)
        packed = np.zeros((values.shape[0], self.width * self.height, 4 * groups), np.float32)
        packed[..., : kind["count"]] = values.reshape(values.shape[0], -1, kind["count"])
        return {"values": Array(packed), "groups": groups, "count": kind["count"], "per_view": per_view}

    # Values

    def footprint(self, uv):
        """The four texels around a texture coordinate, and their weights."""
        size = (self.width, self.height)
        at = (uv.x, 1 - uv.y)
        texels, fractions = [], []
        for x, size in zip(at, size):
            x = (x - dr.floor(x)) * size - 0.5
            cell = dr.floor(x)
            fractions.append(x - cell)
            first = mi.UInt32(dr.select(cell < 0, size - 1, dr.minimum(cell, size - 1)))
            texels.append((first, mi.UInt32(dr.select(first + 1 >= size, 0, first + 1))))
        (x0, x1), (y0, y1) = texels
        fx, fy = fractions
        return [
            (y0 * self.width + x0, (1 - fx) * (1 - fy)),
            (y0 * self.width + x1, fx * (1 - fy)),
            (y1 * self.width + x0, (1 - fx) * fy),
            (y1 * self.width + x1, fx * fy),
        ]

    def mean(self, expr, texels, place):
        """The mean of an expression over texels with weights. What is linear in the numbers of a plane is evaluated once, for
        their mean."""
        kind, content = next(iter(expr.items()))
        if kind == "sum":
            return sum((self.mean(term, texels, place) for term in content), mi.Color3f(0))
        if kind == "channels":
            return mi.Color3f(*(self.mean(term, texels, place)[k] for k, term in enumerate(content)))
        if kind == "product" or content.get("row") is not None:
            values = (self.value(expr, [(texel, 1)], place) * weight for texel, weight in texels)
            return sum(values, mi.Color3f(0))
        return self.value(expr, texels, place)

    def value(self, expr, texels, place):
        kind, content = next(iter(expr.items()))
        if kind == "sum":
            return sum((self.value(term, texels, place) for term in content), mi.Color3f(0))
        if kind == "product":
            result = mi.Color3f(1)
            for term in content:
                result *= self.value(term, texels, place)
            return result
        if kind == "channels":
            return mi.Color3f(*(self.value(term, texels, place)[k] for k, term in enumerate(content)))
        table, row = self.tables[content["table"]], 0
        if content.get("row") is not None:
            row = self.planes[content["row"]]["values"][texels[0][0]]
        if kind == "table":
            return self.interpolated(table, row, place, lambda first, view: self.rgb(table, first))
        plane = self.planes[content["plane"]]
        views = {}

        def product(first, view):
            # the numbers of a view are read once, for all lights
            if id(view) not in views:
                views[id(view)] = self.numbers(plane, view, texels)
            numbers, result = views[id(view)], mi.Color3f(0)
            for k in range(plane["count"]):
                result += numbers[k] * self.rgb(table, first + k)
            return result

        return self.interpolated(table, row, place, product, plane["per_view"])

    def numbers(self, plane, view, texels):
        """The mean numbers of a plane over texels with weights."""
        result = []
        for group in range(plane["groups"]):
            mean = [0, 0, 0, 0]
            for texel, weight in texels:
                at = (view * (self.width * self.height) if plane["per_view"] else 0) + texel
                four = plane["values"].four(at * plane["groups"] + group)
                mean = [mean[k] + weight * four[k] for k in range(4)]
            result += mean
        return result

    def rgb(self, table, place):
        four = table["values"].four(place)
        return mi.Color3f(four[0], four[1], four[2])

    def interpolated(self, table, row, place, value, per_view=False):
        """The sum of weights times what `value` gives for the first component of a cell and its view."""
        _, views, lights, nodes, components, _ = table["shape"]
        nowhere = [(mi.UInt32(0), 1)]
        around_views = place["views"] if views > 1 or per_view else nowhere
        around_lights = place["lights"] if lights > 1 else nowhere
        around_nodes = self.grid(table, place) if table["side"] else nowhere
        result = mi.Color3f(0)
        for view, view_weight in around_views:
            for light, light_weight in around_lights:
                for node, node_weight in around_nodes:
                    cell = ((row * views + (view if views > 1 else 0)) * lights + (light if lights > 1 else 0)) * nodes + node
                    result += view_weight * light_weight * node_weight * value(cell * components, view)
        return result

    def grid(self, table, place):
        """The four nodes around the half or difference vector: Lambert's projection, then the concentric map to a square."""
        side, w = table["side"], dr.normalize(place["wi"] + place["wo"])
        if table["on_grid"] == "difference":
            # the light in the frame of the half vector
            tangent = mi.Vector3f(1, 0, 0) - w * w.x
            tangent /= dr.maximum(dr.norm(tangent), 1e-30)
            wi = place["wi"]
            w = mi.Vector3f(dr.dot(wi, tangent), dr.dot(wi, dr.cross(w, tangent)), dr.dot(wi, w))
        scale = 1 / dr.sqrt(dr.maximum(1 + w.z, 1e-6))
        at = mi.warp.uniform_disk_to_square_concentric(mi.Point2f(w.x * scale, w.y * scale))
        x, y = (dr.clip(v * side - 0.5, 0, side - 1) for v in (at.x, at.y))
        cx, cy = (dr.minimum(dr.floor(v), side - 2) for v in (x, y))
        fx, fy = x - cx, y - cy
        first = mi.UInt32(cy) * side + mi.UInt32(cx)
        return [
            (first, (1 - fx) * (1 - fy)),
            (first + 1, fx * (1 - fy)),
            (first + side, (1 - fx) * fy),
            (first + side + 1, fx * fy),
        ]

    def linear(self, value):
        """Linear light."""
        curve, encoding = self.recipe["curve"], self.btf["encoding"]
        if curve == "display":
            if encoding in ("srgb", "linear"):
                high = dr.power(dr.maximum((value + 0.055) / 1.055, 0), 2.4)
                value = dr.select(value <= 0.04045, value / 12.92, high)
            else:
                value = dr.power(dr.maximum(value, 0), encoding["gamma"])
        elif curve == "log":
            value = dr.exp(dr.minimum(value, 80)) - 1e-3
        elif curve == "log-yuv":
            y = dr.exp(dr.minimum(value[0], 40)) - EPSILON
            u, v = value[1] * (y + EPSILON), value[2] * (y + EPSILON)
            value = mi.Color3f(y + 1.13983 * v, y - 0.39465 * u - 0.58060 * v, y + 2.03211 * u)
        return dr.maximum(value, 0)

    def mean_light(self, texels, place):
        """The mean of linear light over texels and sampled pairs of directions with weights."""
        result = mi.Color3f(0)
        for view, view_weight in place["views"]:
            for light, light_weight in place["lights"]:
                pair = {**place, "views": [(view, 1)], "lights": [(light, 1)]}
                for texel, texel_weight in texels:
                    weight = view_weight * light_weight * texel_weight
                    result += weight * self.linear(self.value(self.recipe["value"], [(texel, 1)], pair))
        return result

    def apparent(self, uv, wi, wo, views=None):
        """Pi times the BRDF times the cosine of the light, for the viewer `wo` and the light `wi`, local frame."""
        views = views or self.views.find(wo)[0]
        lights, fade = self.lights.find(wi)
        place = {"wi": wi, "wo": wo, "views": views, "lights": lights}
        texels = self.footprint(uv)
        if self.is_linear:
            value = self.mean_light(texels, place)
        else:
            value = self.linear(self.mean(self.recipe["value"], texels, place))
        cosine_is_in = self.btf["cosine"] == "included" and self.recipe["curve"] != "brdf"
        return value * (fade if cosine_is_in else wi.z)

    # Sampling

    def histogram(self, uv):
        """The number of the first histogram of the texel's cluster."""
        place = lambda x, size: mi.UInt32(dr.minimum((x - dr.floor(x)) * size, size - 1))
        x, y = place(uv.x, self.lobe_columns), place(1 - uv.y, self.lobe_rows)
        return self.lobe_index[y * self.lobe_columns + x] * self.view_count

    def pdf(self, uv, wi, views):
        """The density of a light direction."""
        theta, phi = dr.acos(dr.clip(wi.z, 0, 1)), dr.atan2(wi.y, wi.x)
        ring = mi.UInt32(dr.clip(theta * (RINGS / (0.5 * math.pi)), 0, RINGS - 1))
        turns = phi / (2 * math.pi)
        sector = mi.UInt32(dr.clip((turns - dr.floor(turns)) * SECTORS, 0, SECTORS - 1))
        cell, first = ring * SECTORS + sector, self.histogram(uv)
        mass = 0
        for view, weight in views:
            base = (first + view) * (RINGS * SECTORS)
            below = self.cumulated[base + dr.maximum(mi.Int32(cell) - 1, 0)]
            mass += weight * (self.cumulated[base + cell] - dr.select(cell > 0, below, 0))
        step = 0.5 * math.pi / RINGS
        low, high = mi.Float(ring) * step, (mi.Float(ring) + 1) * step
        solid_angle = 2 * math.pi / SECTORS * (dr.cos(low) - dr.cos(high))
        return COSINE_SHARE * wi.z / math.pi + (1 - COSINE_SHARE) * mass / solid_angle

    def sample(self, uv, views, random):
        """Draws a light direction."""
        x = (random.x - COSINE_SHARE) / (1 - COSINE_SHARE)
        # choose a view by its weight
        (first, a), (second, b), (third, _) = views
        in_first, in_second = x < a, x < a + b
        view = dr.select(in_first, first, dr.select(in_second, second, third))
        rest = dr.select(in_first, x / dr.maximum(a, 1e-30), dr.select(in_second, (x - a) / dr.maximum(b, 1e-30), (x - a - b) / dr.maximum(1 - a - b, 1e-30)))
        x = dr.clip(rest, 0, 1)
        # search the cell
        base, cells = (self.histogram(uv) + view) * (RINGS * SECTORS), RINGS * SECTORS
        low, high = mi.UInt32(0), mi.UInt32(cells - 1)
        for _ in range(math.ceil(math.log2(cells))):
            middle = (low + high) // 2
            below = self.cumulated[base + middle] <= x
            low, high = dr.select(below, dr.minimum(middle + 1, cells - 1), low), dr.select(below, high, middle)
        cell = mi.UInt32(low)
        before = dr.select(cell > 0, self.cumulated[base + dr.maximum(mi.Int32(cell) - 1, 0)], 0)
        mass = self.cumulated[base + cell] - before
        within = dr.select(mass > 0, dr.clip((x - before) / dr.maximum(mass, 1e-30), 0, 1), 0.5)
        ring = cell // SECTORS
        sector = cell - ring * SECTORS
        step = 0.5 * math.pi / RINGS
        height = lambda k: 2 * dr.square(dr.sin(0.5 * step * mi.Float(k)))
        h = height(ring) + within * (height(ring + 1) - height(ring))
        radius = dr.sqrt(dr.maximum(h * (2 - h), 0))
        sine, cosine = dr.sincos((mi.Float(sector) + random.y) * (2 * math.pi / SECTORS))
        drawn = mi.Vector3f(radius * cosine, radius * sine, 1 - h)
        by_cosine = mi.warp.square_to_cosine_hemisphere(mi.Point2f(dr.clip(random.x / COSINE_SHARE, 0, 1), random.y))
        return dr.select(random.x < COSINE_SHARE, by_cosine, drawn)


class LodenBTF(mi.BSDF):
    """The BSDF `loden_btf`."""

    def __init__(self, props):
        mi.BSDF.__init__(self, props)
        self.material = Material(props.get("folder", "."))
        self.scale = mi.Float(props.get("scale", 1.0))
        to_uv = np.array(props.get("to_uv", mi.ScalarTransform4f()).matrix, dtype=np.float64).reshape(-1)
        side = math.isqrt(to_uv.size)
        matrix = to_uv.reshape(side, side)
        # plain numbers: NumPy's would read the arrays that they multiply
        self.to_uv = matrix[:2, [0, 1, side - 1]].tolist()
        self.to_surface = np.linalg.inv(matrix[:2, :2]).tolist()
        reflection = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.Anisotropic | mi.BSDFFlags.FrontSide
        self.m_components = [reflection]
        self.m_flags = reflection

    def traverse(self, callback):
        callback.put("scale", self.scale, mi.ParamFlags.Differentiable)

    def uv(self, si):
        m = self.to_uv
        x, y = si.uv.x, si.uv.y
        return mi.Point2f(m[0][0] * x + m[0][1] * y + m[0][2], m[1][0] * x + m[1][1] * y + m[1][2])

    def turn(self, si):
        """The rotation about the normal from the shading frame to that of the photographs: cosine, sine, and -1 if texture
        coordinates are mirrored. The shading frame's own tangent means nothing: it differs between versions of Mitsuba."""
        m = self.to_surface
        u = si.sh_frame.to_local(si.dp_du * m[0][0] + si.dp_dv * m[1][0])
        v = si.sh_frame.to_local(si.dp_du * m[0][1] + si.dp_dv * m[1][1])
        length = dr.sqrt(dr.square(u.x) + dr.square(u.y))
        known = length > 0
        length = dr.select(known, length, 1)
        cosine, sine = dr.select(known, u.x / length, 1), dr.select(known, u.y / length, 0)
        return cosine, sine, dr.select(cosine * v.y - sine * v.x < 0, mi.Float(-1), mi.Float(1))

    def to_material(self, turn, w):
        cosine, sine, side = turn
        return mi.Vector3f(cosine * w.x + sine * w.y, side * (cosine * w.y - sine * w.x), w.z)

    def from_material(self, turn, w):
        cosine, sine, side = turn
        return mi.Vector3f(cosine * w.x - sine * side * w.y, sine * w.x + cosine * side * w.y, w.z)

    def prepared(self, si):
        uv, turn = self.uv(si), self.turn(si)
        viewer = self.to_material(turn, si.wi)
        above = viewer.z > 0
        # a direction below the surface would find no cell
        viewer = dr.select(above, viewer, mi.Vector3f(0, 0, 1))
        return uv, turn, viewer, above, self.material.views.find(viewer)[0]

    def values(self, prepared, wo):
        uv, turn, viewer, above, views = prepared
        light = self.to_material(turn, wo)
        lit = above & (light.z > 0)
        light = dr.select(light.z > 0, light, mi.Vector3f(0, 0, 1))
        value = self.material.apparent(uv, light, viewer, views) * (self.scale / math.pi)
        return value, light, lit

    def eval(self, ctx, si, wo, active=True):
        value, _, lit = self.values(self.prepared(si), wo)
        return dr.select(active & lit, value, 0)

    def pdf(self, ctx, si, wo, active=True):
        uv, turn, viewer, above, views = self.prepared(si)
        light = self.to_material(turn, wo)
        return dr.select(active & above & (light.z > 0), self.material.pdf(uv, light, views), 0)

    def eval_pdf(self, ctx, si, wo, active=True):
        prepared = self.prepared(si)
        value, light, lit = self.values(prepared, wo)
        pdf = self.material.pdf(prepared[0], light, prepared[4])
        return dr.select(active & lit, value, 0), dr.select(active & lit, pdf, 0)

    def sample(self, ctx, si, sample1, sample2, active=True):
        prepared = self.prepared(si)
        uv, turn, viewer, above, views = prepared
        light = self.material.sample(uv, views, sample2)
        wo = self.from_material(turn, light)
        value, light, lit = self.values(prepared, wo)
        pdf = self.material.pdf(uv, light, views)
        lit = active & lit & (pdf > 0)
        sample = mi.BSDFSample3f()
        sample.wo, sample.pdf = wo, dr.select(lit, pdf, 0)
        sample.eta, sample.sampled_component = 1.0, mi.UInt32(0)
        sample.sampled_type = mi.UInt32(+mi.BSDFFlags.GlossyReflection)
        return sample, dr.select(lit, value / dr.maximum(pdf, 1e-30), 0)

    def to_string(self):
        return f"LodenBTF[{self.material.width} x {self.material.height} texels]"


mi.register_bsdf("loden_btf", LodenBTF)
