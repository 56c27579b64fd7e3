//! Traversal of the hierarchy by a bundle of rays.

use std::mem::MaybeUninit;

use glam::Vec4;

use super::bundle::{Bundle, RAYS, Row, Triangles, lanes};
use super::simd::{Numbers, Portable, Simd};
use super::{Bvh, Instructions, LEAF, Node, PACKET, Packet, STACK, WIDTH};
use crate::simd::prefetch;

/// Factor on far distances that makes the box test conservative under rounding.
const FAR: f32 = 1.0 + 4.0 * f32::EPSILON;

/// Bound on inverse directions.
pub(super) const HUGE: f32 = 1e18;

/// Shortens the rays to the nearest triangles; returns a bit for each ray that hit one.
pub(super) fn closest(bvh: &Bvh, bundle: &mut Bundle, met: &mut Triangles) -> u16 {
    match bvh.instructions {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has AVX-512.
        Instructions::Avx512 => unsafe { x86::closest_avx512(bvh, bundle, met) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has AVX2.
        Instructions::Avx2 => unsafe { x86::closest_avx2(bvh, bundle, met) },
        Instructions::Portable => closest_with::<Portable>(bvh, bundle, met),
    }
}

/// Returns a bit for each ray that hits a triangle.
pub(super) fn occluded(bvh: &Bvh, bundle: &Bundle) -> u16 {
    match bvh.instructions {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has AVX-512.
        Instructions::Avx512 => unsafe { x86::occluded_avx512(bvh, bundle) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has AVX2.
        Instructions::Avx2 => unsafe { x86::occluded_avx2(bvh, bundle) },
        Instructions::Portable => occluded_with::<Portable>(bvh, bundle),
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::super::simd::x86::{Avx2, Avx512};
    use super::{Bundle, Bvh, Triangles, closest_with, occluded_with};

    #[target_feature(enable = "avx2")]
    pub(super) fn closest_avx2(bvh: &Bvh, bundle: &mut Bundle, met: &mut Triangles) -> u16 {
        closest_with::<Avx2>(bvh, bundle, met)
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn occluded_avx2(bvh: &Bvh, bundle: &Bundle) -> u16 {
        occluded_with::<Avx2>(bvh, bundle)
    }

    #[target_feature(enable = "avx512f")]
    pub(super) fn closest_avx512(bvh: &Bvh, bundle: &mut Bundle, met: &mut Triangles) -> u16 {
        closest_with::<Avx512>(bvh, bundle, met)
    }

    #[target_feature(enable = "avx512f")]
    pub(super) fn occluded_avx512(bvh: &Bvh, bundle: &Bundle) -> u16 {
        occluded_with::<Avx512>(bvh, bundle)
    }
}

/// A group of rays whose directions have the same signs, prepared for tests.
struct Group<L> {
    /// The rays of the bundle that belong to the group.
    mask: u16,
    origin: [L; 3],
    direction: [L; 3],
    inverse: [L; 3],
    /// Twice the moments: directions x origins.
    moment: [L; 3],
    /// Rows of [`Node::bounds`] with the near planes of x, y and z, then those with the far planes.
    rows: [usize; 6],
    corridor: Corridor,
}

/// Bounds on all rays of a group, axis by axis.
struct Corridor {
    /// The origin with the nearest near planes, and the one with the farthest far planes.
    origin: [[f32; 2]; 3],
    /// The smallest and largest inverse direction.
    inverse: [[f32; 2]; 3],
}

/// The rays of a bundle, prepared for tests.
struct Rays<L> {
    origin: [L; 3],
    direction: [L; 3],
    inverse: [L; 3],
    /// Twice the moments: directions x origins.
    moment: [L; 3],
    /// A bit for each ray with a negative direction.
    negative: [u16; 3],
    /// A bit for each ray not yet in a group.
    left: u16,
}

impl<L: Numbers> Rays<L> {
    #[inline(always)]
    fn new(bundle: &Bundle) -> Self {
        let (origin, direction) = (load::<L>(&bundle.origin), load::<L>(&bundle.direction));
        let inverse = [inverse(direction[0]), inverse(direction[1]), inverse(direction[2])];
        let [x, y, z] = cross(&direction, &origin);
        let zero = L::splat(0.0);
        Self {
            origin,
            direction,
            inverse,
            moment: [x + x, y + y, z + z],
            negative: [inverse[0].lt(zero), inverse[1].lt(zero), inverse[2].lt(zero)],
            left: zero.lt(L::load(&bundle.t_max.0)),
        }
    }

    /// Takes the next group of rays whose directions have the same signs.
    #[inline(always)]
    fn next_group(&mut self) -> Option<Group<L>> {
        if self.left == 0 {
            return None;
        }
        let first = self.left.trailing_zeros() as usize % RAYS;
        let mut group = Group {
            mask: self.left,
            origin: self.origin,
            direction: self.direction,
            inverse: self.inverse,
            moment: self.moment,
            rows: [0, 1, 2, 3, 4, 5],
            corridor: Corridor { origin: [[0.0; 2]; 3], inverse: [[0.0; 2]; 3] },
        };
        for axis in 0..3 {
            let negative = self.negative[axis];
            if negative >> first & 1 != 0 {
                group.mask &= negative;
                group.rows.swap(axis, axis + 3);
            } else {
                group.mask &= !negative;
            }
        }
        for axis in 0..3 {
            let [low, high] = range(&only(self.origin[axis], group.mask, first));
            group.corridor.origin[axis] = if group.rows[axis] == axis { [high, low] } else { [low, high] };
            group.corridor.inverse[axis] = range(&only(self.inverse[axis], group.mask, first));
        }
        self.left &= !group.mask;
        Some(group)
    }
}

/// Inverse directions: huge, but finite, where a ray is parallel to a plane, because 0 times infinity would be NaN.
#[inline(always)]
fn inverse<L: Numbers>(direction: L) -> L {
    (L::splat(1.0) / direction).min(L::splat(HUGE)).max(L::splat(-HUGE))
}

#[inline(always)]
fn load<L: Numbers>(rows: &[Row; 3]) -> [L; 3] {
    [L::load(&rows[0].0), L::load(&rows[1].0), L::load(&rows[2].0)]
}

/// The numbers selected by a mask, with one of them repeated in the other places.
#[inline(always)]
fn only<L: Numbers>(x: L, mask: u16, first: usize) -> Row {
    let mut row = Row::ZERO;
    x.store(&mut row.0);
    row = Row([row.0[first]; RAYS]);
    x.store_some(mask, &mut row.0);
    row
}

/// The smallest and largest number of a row.
#[inline(always)]
fn range(row: &Row) -> [f32; 2] {
    let (mut low, mut high) = (row.0, row.0);
    let mut half = RAYS / 2;
    while half > 0 {
        for k in 0..half {
            low[k] = if low[k + half] < low[k] { low[k + half] } else { low[k] };
            high[k] = if high[k + half] > high[k] { high[k + half] } else { high[k] };
        }
        half /= 2;
    }
    [low[0], high[0]]
}

impl<L: Numbers> Group<L> {
    /// A bit for each child whose box some ray may hit before `t_max`.
    #[inline(always)]
    fn near_children<B: Numbers>(&self, node: &Node, t_max: f32) -> u16 {
        let mut entry = B::splat(0.0);
        let mut exit = B::splat(f32::INFINITY);
        for axis in 0..3 {
            let [near, far] = self.corridor.origin[axis];
            let [low, high] = self.corridor.inverse[axis];
            let near = B::load(&node.bounds[self.rows[axis]]) - B::splat(near);
            let far = B::load(&node.bounds[self.rows[3 + axis]]) - B::splat(far);
            entry = entry.max((near * B::splat(low)).min(near * B::splat(high)));
            exit = exit.min((far * B::splat(low)).max(far * B::splat(high)));
        }
        exit = exit * B::splat(FAR);
        entry.le(exit.min(B::splat(t_max)))
    }

    /// Distances at which rays enter a child's box, and a bit for each ray that hits it before `t_max`.
    #[inline(always)]
    fn enter(&self, node: &Node, child: usize, t_max: L) -> (L, u16) {
        let (mut near, mut far) = (L::splat(0.0), t_max);
        for axis in 0..3 {
            let [low, high] = [self.rows[axis], self.rows[3 + axis]].map(|row| node.bounds[row][child]);
            near = near.max((L::splat(low) - self.origin[axis]) * self.inverse[axis]);
            far = far.min((L::splat(high) - self.origin[axis]) * self.inverse[axis] * L::splat(FAR));
        }
        (near, near.le(far))
    }
}

impl Bvh {
    /// Prefetches a child that will be visited.
    #[inline(always)]
    fn prefetch(&self, child: u32) {
        let place = (child & !LEAF) as usize;
        let bytes: &[u8] = if child & LEAF != 0 {
            self.packets.get(place).map_or(&[], |packet| bytemuck::bytes_of(packet))
        } else {
            self.nodes.get(place).map_or(&[], |node| bytemuck::bytes_of(node))
        };
        for line in (0..bytes.len()).step_by(64) {
            prefetch(bytes, line);
        }
    }
}

/// A subtree on the stack.
#[derive(Clone, Copy)]
struct Waiting {
    /// Distances at which the rays of the mask enter it.
    entry: Row,
    /// The smallest of these distances.
    key: f32,
    child: u32,
    mask: u16,
}

#[inline(always)]
fn closest_with<S: Simd>(bvh: &Bvh, bundle: &mut Bundle, met: &mut Triangles) -> u16 {
    let mut hits = 0;
    let mut stack = [const { MaybeUninit::<Waiting>::uninit() }; STACK];
    let mut t_max = bundle.t_max;
    let mut longest = range(&t_max)[1];
    let mut rays = Rays::<S::Rays>::new(bundle);
    while let Some(rays) = rays.next_group() {
        let mut height = 0;
        let (mut child, mut mask) = (0, rays.mask);
        loop {
            if mask != 0 && child & LEAF != 0 {
                // Intersect the triangles of a packet
                let found = packet_hits(&bvh.packets[(child & !LEAF) as usize], &rays, mask, &mut t_max, met);
                if found != 0 {
                    hits |= found;
                    longest = range(&t_max)[1];
                }
            } else if mask != 0 {
                // Push the children that rays enter, nearest on top
                let node = &bvh.nodes[child as usize];
                let (ends, base) = (S::Rays::load(&t_max.0), height);
                for child in lanes(rays.near_children::<S::Boxes>(node, longest)) {
                    let child = child % WIDTH;
                    let (entry, inside) = rays.enter(node, child, ends);
                    let inside = inside & mask;
                    if inside == 0 {
                        continue;
                    }
                    let mut row = Row::ZERO;
                    entry.store(&mut row.0);
                    let key = row.0[inside.trailing_zeros() as usize % RAYS];
                    let new = Waiting { entry: row, key, child: node.child[child], mask: inside };
                    let mut place = height;
                    // SAFETY: entries below the height have been written.
                    while place > base && unsafe { stack[place - 1].assume_init_ref() }.key < key {
                        stack[place] = stack[place - 1];
                        place -= 1;
                    }
                    stack[place].write(new);
                    height += 1;
                    bvh.prefetch(new.child);
                }
            }
            if height == 0 {
                break;
            }
            // Pop the nearest subtree; drop rays that have hit something nearer
            height -= 1;
            // SAFETY: entries below the height have been written.
            let next = unsafe { stack[height].assume_init_ref() };
            child = next.child;
            mask = next.mask & S::Rays::load(&next.entry.0).lt(S::Rays::load(&t_max.0));
        }
    }
    bundle.t_max = t_max;
    hits
}

#[inline(always)]
fn occluded_with<S: Simd>(bvh: &Bvh, bundle: &Bundle) -> u16 {
    let mut hits = 0;
    let mut stack = [const { MaybeUninit::<(u32, u16)>::uninit() }; STACK];
    let t_max = S::Rays::load(&bundle.t_max.0);
    let longest = range(&bundle.t_max)[1];
    let mut rays = Rays::<S::Rays>::new(bundle);
    while let Some(rays) = rays.next_group() {
        let mut height = 0;
        let (mut child, mut mask) = (0, rays.mask);
        loop {
            mask &= !hits;
            if mask != 0 && child & LEAF != 0 {
                // Intersect the triangles of a packet
                hits |= packet_occludes(&bvh.packets[(child & !LEAF) as usize], &rays, mask, t_max);
                if hits & rays.mask == rays.mask {
                    break;
                }
            } else if mask != 0 {
                // Push the children that rays enter
                let node = &bvh.nodes[child as usize];
                for child in lanes(rays.near_children::<S::Boxes>(node, longest)) {
                    let inside = rays.enter(node, child % WIDTH, t_max).1 & mask;
                    if inside != 0 {
                        stack[height].write((node.child[child % WIDTH], inside));
                        height += 1;
                        bvh.prefetch(node.child[child % WIDTH]);
                    }
                }
            }
            if height == 0 {
                break;
            }
            height -= 1;
            // SAFETY: entries below the height have been written.
            (child, mask) = unsafe { stack[height].assume_init() };
        }
    }
    hits
}

/// The edges and planes of four triangles.
struct Sides {
    /// Edges across from the first, second and third corner, and their moments: edge x sum of the ends.
    edges: [[[Vec4; 3]; 2]; 3],
    normal: [Vec4; 3],
    /// Offsets of the planes along the normals.
    offset: Vec4,
}

impl Sides {
    #[inline(always)]
    fn new(packet: &Packet) -> Self {
        let [a, b, c] = &packet.corner;
        let normal = cross(&sub(b, a), &sub(c, a));
        Self { edges: [edge(b, c), edge(c, a), edge(a, b)], normal, offset: dot(a, &normal) }
    }
}

#[inline(always)]
fn sub(a: &[Vec4; 3], b: &[Vec4; 3]) -> [Vec4; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// An edge and its moment.
#[inline(always)]
fn edge(from: &[Vec4; 3], to: &[Vec4; 3]) -> [[Vec4; 3]; 2] {
    let edge = sub(to, from);
    [edge, cross(&edge, &[to[0] + from[0], to[1] + from[1], to[2] + from[2]])]
}

/// Rays that hit a triangle.
struct Meetings<L> {
    hits: u16,
    t: L,
    /// Weights of the second and third corner, and the sum of all three, up to a common factor.
    weights: [L; 3],
}

/// Broadcasts one of four vectors to all rays.
#[inline(always)]
fn splat<L: Numbers>(v: &[Vec4; 3], k: usize) -> [L; 3] {
    [L::splat(v[0][k]), L::splat(v[1][k]), L::splat(v[2][k])]
}

impl<L: Numbers> Group<L> {
    /// The signed volume of rays and an edge: the side on which they pass, and by how much.
    #[inline(always)]
    fn side(&self, sides: &Sides, edge: usize, triangle: usize) -> L {
        let [edge, moment] = &sides.edges[edge];
        dot(&splat(moment, triangle), &self.direction) + dot(&splat(edge, triangle), &self.moment)
    }

    /// Intersects the rays of a mask with one triangle.
    ///
    /// Uses Pluecker coordinates: the side on which a ray passes an edge is the sign of the product of both lines,
    /// which is exactly opposite for the adjacent triangle.
    #[inline(always)]
    fn meet(&self, sides: &Sides, triangle: usize, mask: u16, t_max: L) -> Option<Meetings<L>> {
        let [wa, wb, wc] =
            [self.side(sides, 0, triangle), self.side(sides, 1, triangle), self.side(sides, 2, triangle)];
        let zero = L::splat(0.0);
        let (least, most) = (wa.min(wb).min(wc), wa.max(wb).max(wc));
        let inside = mask & (zero.le(least) | most.le(zero));
        if inside == 0 {
            return None;
        }
        let normal = splat(&sides.normal, triangle);
        let t = (L::splat(sides.offset[triangle]) - dot(&self.origin, &normal)) / dot(&self.direction, &normal);
        // comparisons with NaN, from degenerate triangles, are false
        let hits = inside & zero.lt(t) & t.lt(t_max);
        (hits != 0).then(|| Meetings { hits, t, weights: [wb, wc, wa + wb + wc] })
    }
}

#[inline(always)]
fn packet_hits<L: Numbers>(packet: &Packet, rays: &Group<L>, mask: u16, ends: &mut Row, met: &mut Triangles) -> u16 {
    let sides = Sides::new(packet);
    let mut all = 0;
    for k in 0..PACKET {
        let triangle = packet.triangle[k];
        if triangle == u32::MAX {
            break;
        }
        let Some(found) = rays.meet(&sides, k, mask, L::load(&ends.0)) else { continue };
        let Meetings { hits, t, weights: [wb, wc, sum] } = found;
        t.store_some(hits, &mut ends.0);
        (wb / sum).store_some(hits, &mut met.u.0);
        (wc / sum).store_some(hits, &mut met.v.0);
        let flat = hits & sum.le(L::splat(0.0)) & L::splat(0.0).le(sum);
        if flat != 0 {
            L::splat(0.0).store_some(flat, &mut met.u.0);
            L::splat(0.0).store_some(flat, &mut met.v.0);
        }
        lanes(hits).for_each(|lane| met.triangle[lane] = triangle);
        all |= hits;
    }
    all
}

#[inline(always)]
fn packet_occludes<L: Numbers>(packet: &Packet, rays: &Group<L>, mask: u16, t_max: L) -> u16 {
    let sides = Sides::new(packet);
    let mut all = 0;
    for k in 0..PACKET {
        if packet.triangle[k] == u32::MAX || all == mask {
            break;
        }
        if let Some(found) = rays.meet(&sides, k, mask & !all, t_max) {
            all |= found.hits;
        }
    }
    all
}

#[inline(always)]
fn cross<T: Copy + std::ops::Sub<Output = T> + std::ops::Mul<Output = T>>(a: &[T; 3], b: &[T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot<T: Copy + std::ops::Add<Output = T> + std::ops::Mul<Output = T>>(a: &[T; 3], b: &[T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
