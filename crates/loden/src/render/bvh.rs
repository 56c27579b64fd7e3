//! A bounding volume hierarchy of triangles, eight boxes wide.

mod build;
mod bundle;
mod collapse;
mod simd;
mod traverse;

use glam::{Vec3, Vec4};

pub(crate) use super::ray::Ray;
pub(crate) use bundle::{Bundle, RAYS, lanes};
pub(super) use bundle::{Row, Triangles};

/// Children per node, which are also the boxes tested at once.
const WIDTH: usize = 8;

/// Triangles tested at once.
const PACKET: usize = 4;

/// Entries of the traversal stack; trees that might need more are rebuilt balanced.
const STACK: usize = 256;

/// Marks a child that is a packet of triangles.
const LEAF: u32 = 1 << 31;

/// A hierarchy over the triangles of one mesh.
///
/// # Model
/// obvhs builds a binary tree by locally-ordered clustering and re-insertion, which is then collapsed into the
/// cheapest tree of nodes with up to eight children. Sixteen rays traverse it together: first a bound on all rays is
/// tested against eight boxes at once, then all rays against each remaining box, and against triangles in Pluecker
/// coordinates. The kernels use AVX-512 or AVX2 if available, otherwise SSE2 or plain code, with the same bits. No
/// ray slips between triangles that share an edge.
///
/// # Limits
/// All triangles are held in memory twice, here and in the mesh. Among triangles at the same distance, as at an edge,
/// the one found may depend on the other rays of a bundle.
///
/// # References
/// meister2018, ylitie2017 for the collapse, wald2001, reshetov2005 (bounds of several rays), shevtsov2007 (edges by
/// Pluecker coordinates)
#[derive(Debug, Clone)]
pub struct Bvh {
    nodes: Vec<Node>,
    packets: Vec<Packet>,
    instructions: Instructions,
}

/// Instruction set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Instructions {
    #[cfg(target_arch = "x86_64")]
    Avx512,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    Portable,
}

impl Instructions {
    /// All instruction sets available on this processor, the best one first.
    fn all() -> impl Iterator<Item = Self> {
        #[cfg(target_arch = "x86_64")]
        let special = {
            let (avx512, avx2) = (crate::simd::has_avx512(), crate::simd::has_avx2());
            [avx512.then_some(Self::Avx512), avx2.then_some(Self::Avx2)]
        };
        #[cfg(not(target_arch = "x86_64"))]
        let special = [];
        special.into_iter().flatten().chain([Self::Portable])
    }
}

/// The intersection of a ray and a shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intersection {
    /// Distance along the ray.
    pub t: f32,
    /// Index of the triangle; meaningless for other shapes.
    pub triangle: u32,
    /// Barycentric weight of its second corner.
    pub u: f32,
    /// Barycentric weight of its third corner.
    pub v: f32,
}

impl Intersection {
    /// The intersection with a shape that has no triangles.
    pub(super) fn at(t: f32) -> Self {
        Self { t, triangle: 0, u: 0.0, v: 0.0 }
    }

    /// The same, unless the distance is infinite.
    pub(super) fn within(t: f32) -> Option<Self> {
        t.is_finite().then(|| Self::at(t))
    }
}

#[derive(Debug, Clone, Copy, bytemuck::NoUninit)]
#[repr(C, align(32))]
struct Node {
    /// Lower x, y, z, then upper x, y, z of the eight children; unused children are empty boxes.
    bounds: [[f32; WIDTH]; 6],
    /// Index of a node, or of a packet if [`LEAF`] is set.
    child: [u32; WIDTH],
}

/// Four triangles, lane by lane; unused lanes are degenerate and never hit.
#[derive(Debug, Clone, Copy, bytemuck::NoUninit)]
#[repr(C, align(16))]
struct Packet {
    corner: [[Vec4; 3]; 3],
    triangle: [u32; PACKET],
}

impl Bvh {
    /// Builds the hierarchy; positions must be finite and indices in range.
    pub(crate) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let (nodes, packets) = build::build(triangles);
        Self { nodes, packets, instructions: Instructions::all().next().unwrap_or(Instructions::Portable) }
    }

    /// The nearest triangle with 0 < t < `t_max`, seen from either side.
    pub fn closest(&self, ray: &Ray, t_max: f32) -> Option<Intersection> {
        let (mut bundle, mut met) = (Bundle::EMPTY, Triangles::none());
        bundle.set(0, ray, t_max);
        let hits = self.closest_of(&mut bundle, &mut met);
        (hits != 0).then(|| met.hit(&bundle, 0))
    }

    /// Shortens the rays to the nearest triangles, seen from either side; returns a bit for each ray that hit one.
    pub(super) fn closest_of(&self, bundle: &mut Bundle, met: &mut Triangles) -> u16 {
        traverse::closest(self, bundle, met)
    }

    /// Returns a bit for each ray that hits a triangle.
    pub(crate) fn occluded_of(&self, bundle: &Bundle) -> u16 {
        traverse::occluded(self, bundle)
    }

    /// The same hierarchy with another instruction set.
    #[cfg(test)]
    fn with(&self, instructions: Instructions) -> Self {
        Self { instructions, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Vec3> {
        (-1.0f32..1.0, -1.0f32..1.0, -1.0f32..1.0).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    fn soup() -> impl Strategy<Value = Vec<[Vec3; 3]>> {
        prop::collection::vec((point(), point(), point()), 0..200)
            .prop_map(|list| list.into_iter().map(|(a, b, c)| [a, a + 0.3 * b, a + 0.3 * c]).collect())
    }

    /// An independent double-precision test of all triangles; `slack` shrinks or grows them.
    fn brute_force(triangles: &[[Vec3; 3]], ray: &Ray, slack: f64) -> Option<(f64, usize)> {
        let (o, d) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
        let hit = |(i, triangle): (usize, &[Vec3; 3])| {
            let [a, b, c] = triangle.map(|p| p.as_dvec3());
            let matrix = glam::DMat3::from_cols(b - a, c - a, -d);
            if matrix.determinant() == 0.0 {
                return None;
            }
            let x = matrix.inverse() * (o - a);
            (x.x > -slack && x.y > -slack && x.x + x.y < 1.0 + slack && x.z > -slack).then_some((x.z, i))
        };
        triangles.iter().enumerate().filter_map(hit).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn equals_brute_force(triangles in soup(), rays in prop::collection::vec((point(), point()), 25)) {
            let bvh = Bvh::new(&triangles);
            for (origin, towards) in rays {
                let Some(direction) = (towards - 0.2 * origin).try_normalize() else { continue };
                let ray = Ray { origin: 1.5 * origin, direction };
                let found = bvh.closest(&ray, f32::INFINITY);
                let mut alone = Bundle::EMPTY;
                alone.set(3, &ray, f32::INFINITY);
                prop_assert_eq!(u16::from(found.is_some()) << 3, bvh.occluded_of(&alone));
                let outer = brute_force(&triangles, &ray, 1e-4);
                let inner = brute_force(&triangles, &ray, -1e-4);
                match found {
                    // the result lies between what must be hit and what may be hit
                    Some(hit) => {
                        prop_assert!(outer.is_some_and(|(t, _)| t <= f64::from(hit.t) + 1e-3));
                        prop_assert!(inner.is_none_or(|(t, _)| f64::from(hit.t) <= t + 1e-3));
                        let [a, b, c] = triangles[hit.triangle as usize];
                        let p = a + (b - a) * hit.u + (c - a) * hit.v;
                        prop_assert!((p - (ray.origin + ray.direction * hit.t)).length() < 2e-3);
                        alone.set(3, &ray, hit.t * 0.99);
                        prop_assert!(bvh.occluded_of(&alone) == 0 || hit.t < 1e-3);
                    }
                    None => prop_assert!(inner.is_none()),
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn bundles_find_what_their_rays_find_alone_by_any_instructions(
            triangles in soup(),
            rays in prop::collection::vec((point(), point(), 0.1f32..4.0), 1..=RAYS),
        ) {
            let best = Bvh::new(&triangles);
            let mut start = Bundle::EMPTY;
            for (lane, &(origin, towards, t_max)) in rays.iter().enumerate() {
                let direction = (towards - 0.2 * origin).normalize_or(Vec3::X);
                start.set(lane, &Ray { origin: 1.5 * origin, direction }, t_max);
            }
            for instructions in Instructions::all() {
                let bvh = best.with(instructions);
                let (mut bundle, mut met) = (start.clone(), Triangles::none());
                let hits = bvh.closest_of(&mut bundle, &mut met);
                prop_assert_eq!(hits, bvh.occluded_of(&start));
                prop_assert_eq!(u32::from(hits) >> rays.len(), 0);
                for (lane, &(.., t_max)) in rays.iter().enumerate() {
                    let alone = best.closest(&start.ray(lane), t_max);
                    prop_assert_eq!(alone, (hits >> lane & 1 != 0).then(|| met.hit(&bundle, lane)));
                }
            }
        }
    }

    #[test]
    fn degenerate_input_is_harmless() {
        let ray = Ray { origin: Vec3::ZERO, direction: Vec3::Z };
        assert_eq!(Bvh::new(&[]).closest(&ray, f32::INFINITY), None);
        let point = Bvh::new(&[[Vec3::Z; 3]; 9]);
        assert_eq!(point.closest(&ray, f32::INFINITY), None);
        let one = Bvh::new(&[[Vec3::new(-1.0, -1.0, 2.0), Vec3::new(1.0, -1.0, 2.0), Vec3::new(0.0, 1.0, 2.0)]]);
        assert_eq!(one.closest(&ray, f32::INFINITY).map(|h| h.t), Some(2.0));
        assert_eq!(one.closest(&ray, 2.0), None);
    }

    #[test]
    fn copies_on_one_spot_do_not_overflow_the_stack() {
        let triangle = [Vec3::new(-1.0, -1.0, 2.0), Vec3::new(1.0, -1.0, 2.0), Vec3::new(0.0, 1.0, 2.0)];
        let bvh = Bvh::new(&vec![triangle; 20_000]);
        let ray = Ray { origin: Vec3::ZERO, direction: Vec3::Z };
        assert_eq!(bvh.closest(&ray, f32::INFINITY).map(|h| h.t), Some(2.0));
    }

    #[test]
    fn a_grid_has_no_cracks() {
        let n = 40;
        let p = |i: usize, j: usize| Vec3::new(i as f32 / 7.0, j as f32 / 7.0, ((i * 7 + j * 3) % 5) as f32 * 0.02);
        let mut triangles = Vec::new();
        for (i, j) in (0..n * n).map(|k| (k % n, k / n)) {
            triangles.push([p(i, j), p(i + 1, j), p(i + 1, j + 1)]);
            triangles.push([p(i, j), p(i + 1, j + 1), p(i, j + 1)]);
        }
        let bvh = Bvh::new(&triangles);
        // aim at corners and at midpoints of edges, where cracks would be
        for (i, j) in (0..(n - 1) * (n - 1)).map(|k| (1 + k % (n - 1), 1 + k / (n - 1))) {
            for target in [p(i, j), 0.5 * (p(i, j) + p(i + 1, j + 1)), 0.5 * (p(i, j) + p(i, j + 1))] {
                let origin = Vec3::new(1.3, 4.1, 9.7);
                let ray = Ray { origin, direction: (target - origin).normalize() };
                assert!(bvh.closest(&ray, f32::INFINITY).is_some(), "{target}");
            }
        }
    }
}
