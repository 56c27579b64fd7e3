//! A bounding volume hierarchy of triangles, eight boxes wide.

mod build;
mod collapse;
mod traverse;

use glam::{Vec3, Vec4};

use super::Ray;
pub(super) use traverse::has_avx2;

/// Children of a node, and boxes tested at once.
const WIDTH: usize = 8;

/// Triangles tested at once.
const PACKET: usize = 4;

/// Entries of the traversal stack; trees that could need more are rebuilt balanced.
const STACK: usize = 256;

/// Marks a child that is a packet of triangles.
const LEAF: u32 = 1 << 31;

/// A hierarchy over the triangles of one mesh.
///
/// # Model
/// obvhs builds a binary tree by locally-ordered clustering and re-insertion; it is then collapsed into the cheapest
/// tree of nodes with up to eight children. A ray is tested against eight boxes at once (AVX2
/// where the processor has it, SSE2 or plain code elsewhere, with the same bits) and against four triangles at
/// once by their Pluecker coordinates. No ray slips between triangles that share an edge.
///
/// # Limits
/// All triangles are held in memory twice, here and in the mesh.
///
/// # References
/// meister2018, ylitie2017 for the collapse, shevtsov2007 for edges by Pluecker coordinates
#[derive(Debug, Clone)]
pub struct Bvh {
    nodes: Vec<Node>,
    packets: Vec<Packet>,
    avx2: bool,
}

/// A triangle hit by a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangleHit {
    /// Distance along the ray.
    pub t: f32,
    /// Which triangle.
    pub triangle: u32,
    /// Barycentric weight of its second corner.
    pub u: f32,
    /// Barycentric weight of its third corner.
    pub v: f32,
}

#[derive(Debug, Clone)]
#[repr(C, align(32))]
struct Node {
    /// Lower x, y, z, then upper x, y, z of the eight children; unused ones are empty boxes.
    bounds: [[f32; WIDTH]; 6],
    /// Index of a node, or of a packet with [`LEAF`].
    child: [u32; WIDTH],
}

/// Four triangles, lane by lane; unused lanes are degenerate and never hit.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(16))]
struct Packet {
    corner: [[Vec4; 3]; 3],
    triangle: [u32; PACKET],
}

impl Bvh {
    /// Builds the hierarchy; positions must be finite and indices in range.
    pub(super) fn new(triangles: &[[Vec3; 3]]) -> Self {
        let (nodes, packets) = build::build(triangles);
        Self { nodes, packets, avx2: has_avx2() }
    }

    /// The nearest triangle with 0 < t < `t_max`, seen from either side.
    #[inline]
    pub fn closest(&self, ray: &Ray, t_max: f32) -> Option<TriangleHit> {
        traverse::closest(self, ray, t_max)
    }

    /// Whether there is a triangle with 0 < t < `t_max`.
    #[inline]
    pub fn occluded(&self, ray: &Ray, t_max: f32) -> bool {
        traverse::occluded(self, ray, t_max)
    }

    /// The same hierarchy without the processor's special instructions.
    #[cfg(test)]
    fn portable(&self) -> Self {
        Self { avx2: false, ..self.clone() }
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
                prop_assert_eq!(found, bvh.portable().closest(&ray, f32::INFINITY));
                prop_assert_eq!(found.is_some(), bvh.occluded(&ray, f32::INFINITY));
                prop_assert_eq!(found.is_some(), bvh.portable().occluded(&ray, f32::INFINITY));
                let outer = brute_force(&triangles, &ray, 1e-4);
                let inner = brute_force(&triangles, &ray, -1e-4);
                match found {
                    // what is found lies between what surely must and what just may be hit
                    Some(hit) => {
                        prop_assert!(outer.is_some_and(|(t, _)| t <= f64::from(hit.t) + 1e-3));
                        prop_assert!(inner.is_none_or(|(t, _)| f64::from(hit.t) <= t + 1e-3));
                        let [a, b, c] = triangles[hit.triangle as usize];
                        let p = a + (b - a) * hit.u + (c - a) * hit.v;
                        prop_assert!((p - (ray.origin + ray.direction * hit.t)).length() < 2e-3);
                        prop_assert!(!bvh.occluded(&ray, hit.t * 0.99) || hit.t < 1e-3);
                    }
                    None => prop_assert!(inner.is_none()),
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
        // aimed at corners and at middles of edges, where cracks would be
        for (i, j) in (0..(n - 1) * (n - 1)).map(|k| (1 + k % (n - 1), 1 + k / (n - 1))) {
            for target in [p(i, j), 0.5 * (p(i, j) + p(i + 1, j + 1)), 0.5 * (p(i, j) + p(i, j + 1))] {
                let origin = Vec3::new(1.3, 4.1, 9.7);
                let ray = Ray { origin, direction: (target - origin).normalize() };
                assert!(bvh.closest(&ray, f32::INFINITY).is_some(), "{target}");
            }
        }
    }
}
