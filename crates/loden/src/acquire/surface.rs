//! Exact ray tracing of a periodic height field with two triangles per cell.

use glam::{Vec2, Vec3};

use super::field::{Finish, HeightField};
use super::shade::Shade;

/// Longest ray, in periods: a nearly horizontal ray that hits nothing for this long has escaped.
const REACH: f32 = 16.0;

/// # Model
/// Rays traverse cells and, where the surface is far below, blocks of 2^k x 2^k cells whose maximum height is known (a
/// maximum mipmap). Within a cell, the height of the ray above the surface is piecewise linear with one kink at the
/// diagonal, so the first zero is found without a search. Lengths are in cells, and grid point (i, j) is at x = i, y =
/// j.
///
/// # References
/// musgrave1988, tevs2008
#[derive(Debug)]
pub(super) struct Surface {
    n: usize,
    log: u32,
    heights: Vec<f32>,
    finish: Vec<Finish>,
    /// Largest height of each cell, then of 2 x 2 cells, up to the whole period.
    highest: Vec<Vec<f32>>,
}

/// A ray; lengths are in cells. `d` is a unit vector.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray {
    pub o: Vec3,
    pub d: Vec3,
    inv: Vec2,
}

impl Ray {
    #[inline(always)]
    pub(super) fn new(o: Vec3, d: Vec3) -> Self {
        // zero would give 0 * infinity where the origin is on a grid line
        let inv = |v: f32| 1.0 / if v.abs() < 1e-9 { 1e-9f32.copysign(v) } else { v };
        Self { o, d, inv: Vec2::new(inv(d.x), inv(d.y)) }
    }

    /// A ray in the same direction from another point.
    #[inline(always)]
    pub(super) fn from(self, o: Vec3) -> Self {
        Self { o, ..self }
    }
}

/// A point of the surface: its cell, its triangle (`true` for the upper right one) and its position in cells, with x
/// and y in one period.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub cell: [i32; 2],
    pub upper: bool,
    pub at: Vec3,
}

/// The four corners of a cell: lower left, lower right, upper left, upper right.
type Corners = [f32; 4];

/// Height of the plane of a triangle at a position within its cell.
#[inline(always)]
fn height(c: Corners, upper: bool, x: f32, y: f32) -> f32 {
    if upper {
        c[3] + (1.0 - x) * (c[2] - c[3]) + (1.0 - y) * (c[1] - c[3])
    } else {
        c[0] + x * (c[1] - c[0]) + y * (c[2] - c[0])
    }
}

impl Surface {
    pub(super) fn new(field: &HeightField) -> Self {
        let n = field.grid();
        let log = n.trailing_zeros();
        let heights: Vec<f32> = field.heights().iter().map(|h| h * n as f32).collect();
        let mut surface = Self { n, log, heights, finish: field.finish().to_vec(), highest: Vec::new() };
        let cell = |k: usize| surface.corners([(k % n) as i32, (k / n) as i32]).into_iter().fold(f32::MIN, f32::max);
        surface.highest.push((0..n * n).map(cell).collect());
        for level in 1..=log {
            let (below, side) = (&surface.highest[level as usize - 1], n >> level);
            let block = |k: usize| {
                let first = 2 * (k / side) * 2 * side + 2 * (k % side);
                [first, first + 1, first + 2 * side, first + 2 * side + 1]
                    .iter()
                    .map(|&i| below[i])
                    .fold(f32::MIN, f32::max)
            };
            surface.highest.push((0..side * side).map(block).collect());
        }
        surface
    }

    /// Cells per period.
    pub(super) fn grid(&self) -> usize {
        self.n
    }

    /// Heights in cells, row by row.
    pub(super) fn heights(&self) -> &[f32] {
        &self.heights
    }

    /// The largest height, in cells.
    pub(super) fn top(&self) -> f32 {
        self.highest[self.log as usize][0]
    }

    #[inline(always)]
    fn index(&self, [x, y]: [i32; 2]) -> usize {
        let mask = self.n as i32 - 1;
        (((y & mask) as usize) << self.log) | (x & mask) as usize
    }

    #[inline(always)]
    pub(super) fn corners(&self, [x, y]: [i32; 2]) -> Corners {
        let h = |x, y| self.heights[self.index([x, y])];
        [h(x, y), h(x + 1, y), h(x, y + 1), h(x + 1, y + 1)]
    }

    /// The unit normal of the triangle of `p`.
    #[inline(always)]
    pub(super) fn normal(&self, p: &Point) -> Vec3 {
        let [a, b, c, d] = self.corners(p.cell);
        let slope = if p.upper { Vec2::new(d - c, d - b) } else { Vec2::new(b - a, c - a) };
        (-slope).extend(1.0).normalize()
    }

    /// The finish at `p`, interpolated linearly within its triangle.
    #[inline(always)]
    pub(super) fn finish(&self, p: &Point) -> Finish {
        let [x, y] = p.cell;
        let f = Vec2::new(p.at.x - x as f32, p.at.y - y as f32);
        let at = |p| bytemuck::cast_ref::<Finish, [f32; 8]>(&self.finish[self.index(p)]);
        let (b, c) = (at([x + 1, y]), at([x, y + 1]));
        let (third, weight) = if p.upper {
            (at([x + 1, y + 1]), [1.0 - f.y, 1.0 - f.x, f.x + f.y - 1.0])
        } else {
            (at([x, y]), [f.x, f.y, 1.0 - f.x - f.y])
        };
        bytemuck::cast(std::array::from_fn::<f32, 8, _>(|k| b[k] * weight[0] + c[k] * weight[1] + third[k] * weight[2]))
    }

    /// Whether the point `own` is in the shadow of light number `light`. `ray` starts there and points to the light.
    /// Traverses cells until the bounds in `shade` decide.
    #[inline(always)]
    pub(super) fn is_dark(&self, ray: &Ray, own: &Point, light: usize, shade: &Shade) -> bool {
        let &Ray { o, d, inv } = ray;
        let right = [i32::from(inv.x > 0.0), i32::from(inv.y > 0.0)];
        let (mut cell, mut t, mut leaves) = (own.cell, 0.0f32, Some(own.upper));
        let reach = REACH * self.n as f32;
        let mut known = shade.range(shade.block(cell), light);
        while t < reach {
            let tx = ((cell[0] + right[0]) as f32 - o.x) * inv.x;
            let ty = ((cell[1] + right[1]) as f32 - o.y) * inv.y;
            let exit = tx.min(ty).max(t);
            if o.z + t * d.z <= self.highest_in(cell, 0) && self.meet(ray, cell, t, exit, leaves).is_some() {
                return true;
            }
            (t, leaves) = (exit, None);
            let axis = usize::from(tx >= ty);
            cell[axis] += 2 * right[axis] - 1;
            let (block, z) = (shade.block(cell), o.z + t * d.z);
            if block != known.block {
                known = shade.range(block, light);
            }
            if z > known.above {
                return false;
            }
            if z < known.below {
                return true;
            }
        }
        false
    }

    /// The first hit of `ray`. `own` is the point it starts from, whose triangle it cannot hit.
    #[inline(always)]
    pub(super) fn trace(&self, ray: &Ray, own: Option<&Point>) -> Option<Point> {
        let &Ray { o, d, inv } = ray;
        // use the inverse, which has a sign even where the direction is zero
        let right = [i32::from(inv.x > 0.0), i32::from(inv.y > 0.0)];
        let (top, reach) = (self.top(), REACH * self.n as f32);
        let mut cell = own.map_or([o.x.floor() as i32, o.y.floor() as i32], |p| p.cell);
        let mut own = own.map(|p| p.upper);
        let (mut level, mut t) = (0, 0.0f32);
        // a ray crosses at most this many blocks, on all axes and levels
        for _ in 0..(4 * (REACH as usize + 1) * self.n * (self.log as usize + 1)) {
            let low = o.z + t * d.z;
            if (d.z >= 0.0 && low > top) || t > reach {
                return None;
            }
            let block = cell.map(|c| c >> level);
            let tx = (((block[0] + right[0]) << level) as f32 - o.x) * inv.x;
            let ty = (((block[1] + right[1]) << level) as f32 - o.y) * inv.y;
            let exit = tx.min(ty).max(t);
            let low = if d.z < 0.0 { o.z + exit * d.z } else { low };
            if low <= self.highest_in(block, level) {
                if level > 0 {
                    level -= 1;
                    continue;
                }
                if let Some((t, upper)) = self.meet(ray, cell, t, exit, own) {
                    return Some(self.point(cell, upper, o + t * d));
                }
            }
            own = None;
            t = exit;
            let (axis, other) = if tx < ty { (0, 1) } else { (1, 0) };
            cell[axis] = if right[axis] == 1 { (block[axis] + 1) << level } else { (block[axis] << level) - 1 };
            let first = block[other] << level;
            cell[other] = ((o[other] + t * d[other]).floor() as i32).clamp(first, first + (1 << level) - 1);
            // ascend when entering a new parent block
            if level < self.log && (cell[axis] >> (level + 1)) != (block[axis] >> 1) {
                level += 1;
            }
        }
        None
    }

    #[inline(always)]
    fn highest_in(&self, block: [i32; 2], level: u32) -> f32 {
        let bits = self.log - level;
        let mask = (1i32 << bits) - 1;
        self.highest[level as usize][(((block[1] & mask) as usize) << bits) | (block[0] & mask) as usize]
    }

    /// Intersects the ray with the surface of one cell between `t0` and `t1`, except the triangle `own`.
    #[inline(always)]
    fn meet(&self, ray: &Ray, cell: [i32; 2], t0: f32, t1: f32, own: Option<bool>) -> Option<(f32, bool)> {
        let c = self.corners(cell);
        let (ox, oy) = (ray.o.x - cell[0] as f32, ray.o.y - cell[1] as f32);
        let above = |t: f32, upper| ray.o.z + t * ray.d.z - height(c, upper, ox + t * ray.d.x, oy + t * ray.d.y);
        // the sign of x + y - 1 distinguishes the triangles
        let side = |t: f32| ox + oy - 1.0 + t * (ray.d.x + ray.d.y);
        let (s0, s1) = (side(t0), side(t1));
        let (first, last) = (own.unwrap_or(s0 > 0.0), s1 > 0.0);
        let through = |a: f32, b: f32, upper| {
            let below = above(b, upper);
            let start = above(a, upper).max(0.0);
            (below < 0.0).then(|| (a + (b - a) * (start / (start - below)), upper))
        };
        if first == last {
            return if own.is_some() { None } else { through(t0, t1, last) };
        }
        let kink = (t0 + (t1 - t0) * (s0 / (s0 - s1)).clamp(0.0, 1.0)).clamp(t0, t1);
        let before = if own.is_some() { None } else { through(t0, kink, first) };
        before.or_else(|| through(kink, t1, last))
    }

    /// The surface point of a cell near a position: projected onto the plane of the triangle and wrapped into the
    /// period.
    #[inline(always)]
    fn point(&self, cell: [i32; 2], upper: bool, near: Vec3) -> Point {
        let f = |k: usize| (near[k] - cell[k] as f32).clamp(0.0, 1.0);
        let z = height(self.corners(cell), upper, f(0), f(1));
        let wrapped = cell.map(|c| c & (self.n as i32 - 1));
        Point { cell: wrapped, upper, at: Vec3::new(wrapped[0] as f32 + f(0), wrapped[1] as f32 + f(1), z) }
    }
}
