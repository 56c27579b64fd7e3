//! Bilinear and bicubic patches.

use glam::{Mat4, Vec2, Vec3, Vec4};

use super::{At, tessellate};
use crate::render::MeshData;

/// Steps per bicubic patch and direction.
const BICUBIC_STEPS: usize = 16;
/// Steps per bilinear patch and direction; a flat one needs no more than one.
const BILINEAR_STEPS: usize = 8;

/// The weights of four control points: rows of the matrix are powers t^3, t^2, t, 1 from the first on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Basis {
    /// Its columns belong to the powers: `weights = matrix * (t^3, t^2, t, 1)`.
    matrix: Mat4,
    /// How many control points the next patch of a mesh is further.
    pub step: usize,
}

impl Basis {
    /// Bezier's.
    pub const BEZIER: Self =
        Self::new([-1.0, 3.0, -3.0, 1.0, 3.0, -6.0, 3.0, 0.0, -3.0, 3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 3);
    /// Uniform cubic B-splines.
    pub const B_SPLINE: Self = {
        const S: f32 = 1.0 / 6.0;
        let m = [
            -S,
            3.0 * S,
            -3.0 * S,
            S,
            3.0 * S,
            -6.0 * S,
            3.0 * S,
            0.0,
            -3.0 * S,
            0.0,
            3.0 * S,
            0.0,
            S,
            4.0 * S,
            S,
            0.0,
        ];
        Self::new(m, 1)
    };
    /// Catmull's and Rom's, through its points.
    pub const CATMULL_ROM: Self =
        Self::new([-0.5, 1.5, -1.5, 0.5, 1.0, -2.5, 2.0, -0.5, -0.5, 0.0, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0], 1);
    /// Hermite's: point, slope, point, slope.
    pub const HERMITE: Self =
        Self::new([2.0, 1.0, -2.0, 1.0, -3.0, -2.0, 3.0, -1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 2);
    /// Powers themselves.
    pub const POWER: Self =
        Self::new([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0], 4);

    /// A basis from the four rows for t^3, t^2, t and 1, as RIB writes them.
    pub const fn new(rows: [f32; 16], step: usize) -> Self {
        Self { matrix: Mat4::from_cols_array(&rows), step }
    }

    /// The basis of this name in RIB.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "bezier" => Self::BEZIER,
            "b-spline" => Self::B_SPLINE,
            "catmull-rom" => Self::CATMULL_ROM,
            "hermite" => Self::HERMITE,
            "power" => Self::POWER,
            _ => return None,
        })
    }

    /// Weights of the points at t, and their derivatives.
    fn weights(&self, t: f32) -> [Vec4; 2] {
        [self.matrix * Vec4::new(t * t * t, t * t, t, 1.0), self.matrix * Vec4::new(3.0 * t * t, 2.0 * t, 1.0, 0.0)]
    }
}

/// Four corners of texture coordinates: (0, 0), (1, 0), (0, 1), (1, 1) of the parameters.
pub type Corners = [Vec2; 4];

/// Control points of one patch, u first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch<const N: usize> {
    /// Rows along u, v from row to row.
    pub points: [Vec3; N],
    /// Texture coordinates of the corners.
    pub uvs: Corners,
}

/// Bicubic patches of 4 x 4 points as triangles.
pub fn bicubic_mesh(patches: &[Patch<16>], u_basis: &Basis, v_basis: &Basis) -> MeshData {
    let mut data = MeshData::default();
    for patch in patches {
        tessellate(&mut data, [BICUBIC_STEPS; 2], |u, v| {
            let ([bu, du], [bv, dv]) = (u_basis.weights(u), v_basis.weights(v));
            let sum = |bu: Vec4, bv: Vec4| {
                let row = |j: usize| (0..4).map(|i| patch.points[4 * j + i] * bu[i]).sum::<Vec3>();
                (0..4).map(|j| row(j) * bv[j]).sum::<Vec3>()
            };
            At { position: sum(bu, bv), along_u: sum(du, bv), along_v: sum(bu, dv), uv: bilinear(&patch.uvs, u, v) }
        });
    }
    data
}

/// Bilinear patches of 2 x 2 points as triangles.
pub fn bilinear_mesh(patches: &[Patch<4>]) -> MeshData {
    let mut data = MeshData::default();
    for patch in patches {
        let [a, b, c, d] = patch.points;
        let flat = (b - a).cross(c - a).dot(d - a) == 0.0 && a + d == b + c;
        let steps = if flat { 1 } else { BILINEAR_STEPS };
        tessellate(&mut data, [steps; 2], |u, v| At {
            position: a.lerp(b, u).lerp(c.lerp(d, u), v),
            along_u: (b - a).lerp(d - c, v),
            along_v: (c - a).lerp(d - b, u),
            uv: bilinear(&patch.uvs, u, v),
        });
    }
    data
}

fn bilinear(corners: &Corners, u: f32, v: f32) -> Vec2 {
    corners[0].lerp(corners[1], u).lerp(corners[2].lerp(corners[3], u), v)
}

#[cfg(test)]
mod tests {
    use super::*;

    const UVS: Corners = [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE];

    /// A polynomial of degree 3 in each direction.
    fn surface(u: f32, v: f32) -> Vec3 {
        Vec3::new(u + 0.2 * v * v, v - 0.1 * u * u * u, u * u * v - v * v * v + 0.3 * u)
    }

    /// Blossom: what control points of a basis give the polynomial t^k.
    fn control(name: &str, k: i32, i: usize) -> f32 {
        let power = |t: f32| t.powi(k);
        match name {
            // the polar form of t^k at (0,0,0), (0,0,1), (0,1,1), (1,1,1), or the knots around 0..1
            "bezier" => polar(k, [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 1.0]][i]),
            "b-spline" => polar(k, [[-2.0, -1.0, 0.0], [-1.0, 0.0, 1.0], [0.0, 1.0, 2.0], [1.0, 2.0, 3.0]][i]),
            "hermite" => [power(0.0), if k == 1 { 1.0 } else { 0.0 }, 1.0, k as f32][i],
            _ => f32::from(3 - i as i32 == k),
        }
    }

    fn polar(k: i32, [a, b, c]: [f32; 3]) -> f32 {
        match k {
            0 => 1.0,
            1 => (a + b + c) / 3.0,
            2 => (a * b + b * c + c * a) / 3.0,
            _ => a * b * c,
        }
    }

    #[test]
    fn every_basis_reproduces_cubic_polynomials() {
        // coefficients of the surface: power of u, power of v, vector
        let terms = [
            (1, 0, Vec3::new(1.0, 0.0, 0.3)),
            (0, 2, Vec3::new(0.2, 0.0, 0.0)),
            (0, 1, Vec3::Y),
            (3, 0, Vec3::new(0.0, -0.1, 0.0)),
            (2, 1, Vec3::Z),
            (0, 3, -Vec3::Z),
        ];
        for name in ["bezier", "b-spline", "hermite", "power"] {
            let basis = Basis::named(name).unwrap();
            let point = |i: usize, j: usize| {
                terms.iter().map(|(p, q, c)| *c * control(name, *p, i) * control(name, *q, j)).sum::<Vec3>()
            };
            let points = std::array::from_fn(|k| point(k % 4, k / 4));
            let data = bicubic_mesh(&[Patch { points, uvs: UVS }], &basis, &basis);
            for (p, uv) in data.positions.iter().zip(&data.uvs) {
                assert!((*p - surface(uv.x, uv.y)).length() < 1e-5, "{name} {uv}: {p}");
            }
        }
        let rom = Basis::CATMULL_ROM.weights(0.0)[0];
        assert_eq!(rom, Vec4::Y, "it passes through its points");
        assert!((Basis::CATMULL_ROM.weights(0.3)[0].element_sum() - 1.0).abs() < 1e-6);
        assert!(Basis::named("spline").is_none());
    }

    #[test]
    fn bilinear_patches_are_flat_or_twisted() {
        let points = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.0)];
        let flat = bilinear_mesh(&[Patch { points, uvs: UVS }]);
        assert_eq!((flat.triangles.len(), flat.normals[0]), (2, Vec3::Z));
        let points = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE];
        let twisted = bilinear_mesh(&[Patch { points, uvs: UVS }]);
        assert!(twisted.positions.iter().all(|p| (p.z - p.x * p.y).abs() < 1e-6));
        let normal = |p: &Vec3| Vec3::new(-p.y, -p.x, 1.0).normalize();
        assert!(twisted.positions.iter().zip(&twisted.normals).all(|(p, n)| (*n - normal(p)).length() < 1e-5));
    }

    #[test]
    fn corners_drawn_together_have_a_normal() {
        let points = [Vec3::ZERO, Vec3::ZERO, Vec3::Y, Vec3::new(1.0, 1.0, 0.0)];
        let data = bilinear_mesh(&[Patch { points, uvs: UVS }]);
        assert!(data.normals.iter().all(|n| (*n - Vec3::Z).length() < 1e-5));
    }
}
