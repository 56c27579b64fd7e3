//! The walk of one ray through the hierarchy.

use std::mem::MaybeUninit;

use glam::{Vec3, Vec4};

use super::{Bvh, LEAF, Node, PACKET, Packet, STACK, TriangleHit, WIDTH};
use crate::render::Ray;

/// Growth of the far distance that makes the box test conservative against rounding.
const FAR: f32 = 1.0 + 4.0 * f32::EPSILON;

/// Whether the processor has AVX2.
pub(in crate::render) fn has_avx2() -> bool {
    #[cfg(target_arch = "x86_64")]
    return is_x86_feature_detected!("avx2");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

#[inline]
pub(super) fn closest(bvh: &Bvh, ray: &Ray, t_max: f32) -> Option<TriangleHit> {
    #[cfg(target_arch = "x86_64")]
    if bvh.avx2 {
        // SAFETY: the flag says that the processor has AVX2.
        return unsafe { avx2::closest(bvh, ray, t_max) };
    }
    closest_with::<Portable>(bvh, ray, t_max)
}

#[inline]
pub(super) fn occluded(bvh: &Bvh, ray: &Ray, t_max: f32) -> bool {
    #[cfg(target_arch = "x86_64")]
    if bvh.avx2 {
        // SAFETY: the flag says that the processor has AVX2.
        return unsafe { avx2::occluded(bvh, ray, t_max) };
    }
    occluded_with::<Portable>(bvh, ray, t_max)
}

/// A ray prepared for box tests.
struct Prepared {
    origin: Vec3,
    direction: Vec3,
    inverse: Vec3,
    /// Rows of [`Node::bounds`] with the near planes of x, y and z, then those with the far planes.
    rows: [usize; 6],
}

impl Prepared {
    #[inline(always)]
    fn new(ray: &Ray) -> Self {
        // a direction parallel to a plane gets a huge but finite inverse: 0 times infinity would be NaN
        let away = |d: f32| if d.abs() < 1e-18 { 1e-18f32.copysign(d) } else { d };
        let d = Vec3::new(away(ray.direction.x), away(ray.direction.y), away(ray.direction.z));
        let near = |axis: usize| if d[axis] < 0.0 { axis + 3 } else { axis };
        let far = |axis: usize| if d[axis] < 0.0 { axis } else { axis + 3 };
        let rows = [near(0), near(1), near(2), far(0), far(1), far(2)];
        Self { origin: ray.origin, direction: ray.direction, inverse: d.recip(), rows }
    }
}

/// The test of eight boxes: a bit per child that is hit, and the distances at which it is entered.
trait Boxes {
    fn enter(node: &Node, ray: &Prepared, t_max: f32, entry: &mut [f32; WIDTH]) -> u32;
}

/// The test for processors without AVX2.
struct Portable;

impl Boxes for Portable {
    #[inline(always)]
    fn enter(node: &Node, ray: &Prepared, t_max: f32, entry: &mut [f32; WIDTH]) -> u32 {
        let mut mask = 0;
        for half in 0..WIDTH / 4 {
            let lanes = |row: usize| Vec4::from_slice(&node.bounds[ray.rows[row]][4 * half..][..4]);
            let t =
                |row: usize, axis: usize| (lanes(row) - Vec4::splat(ray.origin[axis])) * Vec4::splat(ray.inverse[axis]);
            let near = t(0, 0).max(t(1, 1)).max(t(2, 2).max(Vec4::ZERO));
            let far = t(3, 0).min(t(4, 1)).min(t(5, 2)) * FAR;
            mask |= near.cmple(far.min(Vec4::splat(t_max))).bitmask() << (4 * half);
            entry[4 * half..][..4].copy_from_slice(&near.to_array());
        }
        mask
    }
}

/// A subtree that waits for its turn.
#[derive(Clone, Copy)]
struct Waiting {
    entry: f32,
    child: u32,
}

/// What waits to be visited. Its memory is not cleared first: that would cost as much as a short walk.
struct Stack<T> {
    entries: [MaybeUninit<T>; STACK],
    height: usize,
}

impl<T: Copy> Stack<T> {
    #[inline(always)]
    fn new(first: T) -> Self {
        let mut stack = Self { entries: [const { MaybeUninit::uninit() }; STACK], height: 0 };
        stack.push(first);
        stack
    }

    #[inline(always)]
    fn push(&mut self, entry: T) {
        // indexing checks the bound; trees are built so that it is never reached
        self.entries[self.height].write(entry);
        self.height += 1;
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<T> {
        self.height = self.height.checked_sub(1)?;
        // SAFETY: all entries below the height have been written.
        Some(unsafe { self.entries[self.height].assume_init() })
    }
}

impl Stack<Waiting> {
    /// Adds one more of a node's children, which begin at `base`; the nearest stays on top.
    #[inline(always)]
    fn insert(&mut self, base: usize, new: Waiting) {
        self.push(new);
        let mut k = self.height - 1;
        while k > base {
            // SAFETY: k - 1 is at least base and below the height, where all entries have been written.
            let below = unsafe { self.entries[k - 1].assume_init() };
            if below.entry >= new.entry {
                break;
            }
            self.entries[k].write(below);
            k -= 1;
        }
        self.entries[k].write(new);
    }
}

#[inline(always)]
fn closest_with<B: Boxes>(bvh: &Bvh, ray: &Ray, mut t_max: f32) -> Option<TriangleHit> {
    let prepared = Prepared::new(ray);
    let mut stack = Stack::new(Waiting { entry: 0.0, child: 0 });
    let mut entry = [0.0; WIDTH];
    let mut best = None;
    while let Some(waiting) = stack.pop() {
        if waiting.entry >= t_max {
            continue;
        }
        let mut child = waiting.child;
        // go down into the nearest child until there is a leaf, leaving the others on the stack
        loop {
            if child & LEAF != 0 {
                if let Some(hit) = packet_hit(&bvh.packets[(child & !LEAF) as usize], &prepared, t_max) {
                    t_max = hit.t;
                    best = Some(hit);
                }
                break;
            }
            let node = &bvh.nodes[child as usize];
            let mut mask = B::enter(node, &prepared, t_max, &mut entry);
            if mask == 0 {
                break;
            }
            let first = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let mut nearest = Waiting { entry: entry[first], child: node.child[first] };
            let base = stack.height;
            while mask != 0 {
                let lane = mask.trailing_zeros() as usize;
                mask &= mask - 1;
                let mut other = Waiting { entry: entry[lane], child: node.child[lane] };
                if other.entry < nearest.entry {
                    std::mem::swap(&mut other, &mut nearest);
                }
                stack.insert(base, other);
            }
            child = nearest.child;
        }
    }
    best
}

#[inline(always)]
fn occluded_with<B: Boxes>(bvh: &Bvh, ray: &Ray, t_max: f32) -> bool {
    let prepared = Prepared::new(ray);
    let mut stack = Stack::new(0u32);
    let mut entry = [0.0; WIDTH];
    while let Some(child) = stack.pop() {
        if child & LEAF != 0 {
            if packet_hit(&bvh.packets[(child & !LEAF) as usize], &prepared, t_max).is_some() {
                return true;
            }
            continue;
        }
        let node = &bvh.nodes[child as usize];
        let mut mask = B::enter(node, &prepared, t_max, &mut entry);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            stack.push(node.child[lane]);
        }
    }
    false
}

/// The nearest hit among four triangles.
///
/// A corner-free test by Pluecker coordinates: the side on which the ray passes an edge is computed from the sum
/// and the difference of the edge's ends, so it is exactly opposite for the triangle on the other side of it.
#[inline(always)]
fn packet_hit(packet: &Packet, ray: &Prepared, t_max: f32) -> Option<TriangleHit> {
    type V = [Vec4; 3];
    let splat = |v: Vec3| -> V { [Vec4::splat(v.x), Vec4::splat(v.y), Vec4::splat(v.z)] };
    let cross =
        |a: &V, b: &V| -> V { [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]] };
    let dot = |a: &V, b: &V| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let sub = |a: &V, b: &V| -> V { [a[0] - b[0], a[1] - b[1], a[2] - b[2]] };
    let add = |a: &V, b: &V| -> V { [a[0] + b[0], a[1] + b[1], a[2] + b[2]] };
    let (origin, direction) = (splat(ray.origin), splat(ray.direction));
    let [a, b, c] = [0, 1, 2].map(|k| sub(&packet.corner[k], &origin));
    let side = |from: &V, to: &V| dot(&cross(&sub(to, from), &add(to, from)), &direction);
    // weights of c, a and b: each is the side of the edge across from it
    let (wc, wa, wb) = (side(&a, &b), side(&b, &c), side(&c, &a));
    let zero = Vec4::ZERO;
    let inside =
        (wa.cmpge(zero) & wb.cmpge(zero) & wc.cmpge(zero)) | (wa.cmple(zero) & wb.cmple(zero) & wc.cmple(zero));
    if inside.bitmask() == 0 {
        return None;
    }
    let normal = cross(&sub(&b, &a), &sub(&c, &a));
    let t = dot(&a, &normal) / dot(&direction, &normal);
    // comparisons with NaN, from degenerate triangles, are false
    let mut mask = (inside & t.cmpgt(zero) & t.cmplt(Vec4::splat(t_max))).bitmask();
    if mask == 0 {
        return None;
    }
    let t = t.to_array();
    let mut lane = mask.trailing_zeros() as usize;
    mask &= mask - 1;
    while mask != 0 {
        let other = mask.trailing_zeros() as usize;
        mask &= mask - 1;
        if t[other] < t[lane] {
            lane = other;
        }
    }
    let lane = lane % PACKET;
    let sum = wa[lane] + wb[lane] + wc[lane];
    let (u, v) = if sum == 0.0 { (0.0, 0.0) } else { (wb[lane] / sum, wc[lane] / sum) };
    Some(TriangleHit { t: t[lane], triangle: packet.triangle[lane], u, v })
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use std::arch::x86_64::{
        __m256, _CMP_LE_OQ, _mm256_cmp_ps, _mm256_load_ps, _mm256_max_ps, _mm256_min_ps, _mm256_movemask_ps,
        _mm256_mul_ps, _mm256_set1_ps, _mm256_setzero_ps, _mm256_storeu_ps, _mm256_sub_ps,
    };

    use super::{Boxes, Bvh, FAR, Node, Prepared, Ray, TriangleHit, WIDTH, closest_with, occluded_with};

    struct Avx2;

    impl Boxes for Avx2 {
        #[inline(always)]
        fn enter(node: &Node, ray: &Prepared, t_max: f32, entry: &mut [f32; WIDTH]) -> u32 {
            // SAFETY: only instantiated in the functions below, which require AVX2. Rows are eight numbers in
            // a node aligned to 32 bytes, and 32 bytes long, so loads are aligned and in bounds.
            unsafe {
                let t = |row: usize, axis: usize| -> __m256 {
                    let plane = _mm256_load_ps(node.bounds[ray.rows[row]].as_ptr());
                    let origin = _mm256_set1_ps(ray.origin[axis]);
                    _mm256_mul_ps(_mm256_sub_ps(plane, origin), _mm256_set1_ps(ray.inverse[axis]))
                };
                let near = _mm256_max_ps(_mm256_max_ps(t(0, 0), t(1, 1)), _mm256_max_ps(t(2, 2), _mm256_setzero_ps()));
                let far = _mm256_min_ps(_mm256_min_ps(t(3, 0), t(4, 1)), t(5, 2));
                let far = _mm256_min_ps(_mm256_mul_ps(far, _mm256_set1_ps(FAR)), _mm256_set1_ps(t_max));
                _mm256_storeu_ps(entry.as_mut_ptr(), near);
                _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(near, far)) as u32
            }
        }
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn closest(bvh: &Bvh, ray: &Ray, t_max: f32) -> Option<TriangleHit> {
        closest_with::<Avx2>(bvh, ray, t_max)
    }

    #[target_feature(enable = "avx2")]
    pub(super) fn occluded(bvh: &Bvh, ray: &Ray, t_max: f32) -> bool {
        occluded_with::<Avx2>(bvh, ray, t_max)
    }
}
