//! Bilinear and bicubic patches.

use glam::{Mat4, Vec2, Vec3, Vec4};

use super::{SurfacePoint, tessellate};
use crate::render::MeshData;
use crate::{Error, Result};

/// Segments per side of a bicubic patch.
const BICUBIC_STEPS: usize = 16;
/// Segments per side of a bilinear patch that is not flat.
const BILINEAR_STEPS: usize = 8;

/// A cubic basis: the weights of four control points as polynomials of the curve parameter t.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Basis {
    /// `weights = matrix * (t^3, t^2, t, 1)`.
    matrix: Mat4,
    /// Offset from one patch of a mesh to the next, in control points.
    pub step: usize,
}

impl Basis {
    /// Bézier.
    pub const BEZIER: Self =
        Self::new([-1.0, 3.0, -3.0, 1.0, 3.0, -6.0, 3.0, 0.0, -3.0, 3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 3);
    /// Uniform cubic B-spline.
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
    /// Catmull-Rom, which interpolates its control points.
    pub const CATMULL_ROM: Self =
        Self::new([-0.5, 1.5, -1.5, 0.5, 1.0, -2.5, 2.0, -0.5, -0.5, 0.0, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0], 1);
    /// Hermite: point, slope, point, slope.
    pub const HERMITE: Self =
        Self::new([2.0, 1.0, -2.0, 1.0, -3.0, -2.0, 3.0, -1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 2);
    /// Monomials: the control points are the coefficients of t^3, t^2, t and 1.
    pub const POWER: Self =
        Self::new([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0], 4);

    /// A basis from four rows, the weights at t^3, t^2, t and 1, as in RIB.
    pub const fn new(rows: [f32; 16], step: usize) -> Self {
        Self { matrix: Mat4::from_cols_array(&rows), step }
    }

    /// The basis with this RIB name.
    ///
    /// # Errors
    /// [`Error::Parameter`] if there is none.
    pub fn by_name(name: &str) -> Result<Self> {
        const BASES: [(&str, Basis); 5] = [
            ("bezier", Basis::BEZIER),
            ("b-spline", Basis::B_SPLINE),
            ("catmull-rom", Basis::CATMULL_ROM),
            ("hermite", Basis::HERMITE),
            ("power", Basis::POWER),
        ];
        BASES.iter().find(|(known, _)| *known == name).map(|(_, basis)| *basis).ok_or_else(|| {
            let names = BASES.map(|(name, _)| name).join(", ");
            Error::parameter("basis", format!("found {name:?}, expected one of: {names}"))
        })
    }

    /// The weights of the control points at t and their derivatives.
    pub(in crate::render) fn weights(&self, t: f32) -> [Vec4; 2] {
        [self.matrix * Vec4::new(t * t * t, t * t, t, 1.0), self.matrix * Vec4::new(3.0 * t * t, 2.0 * t, 1.0, 0.0)]
    }
}

/// Texture coordinates at the parameters (0, 0), (1, 0), (0, 1), (1, 1).
pub type Corners = [Vec2; 4];

/// A patch: its control points and texture coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Patch<const N: usize> {
    /// Control points; u varies fastest.
    pub points: [Vec3; N],
    /// Texture coordinates of the corners.
    pub uvs: Corners,
}

/// Tessellates bicubic patches of 4 x 4 control points.
pub fn bicubic_mesh(patches: &[Patch<16>], u_basis: &Basis, v_basis: &Basis) -> MeshData {
    let mut data = MeshData::default();
    for patch in patches {
        tessellate(&mut data, [BICUBIC_STEPS; 2], |u, v| {
            let ([bu, du], [bv, dv]) = (u_basis.weights(u), v_basis.weights(v));
            let sum = |bu: Vec4, bv: Vec4| {
                let row = |j: usize| (0..4).map(|i| patch.points[4 * j + i] * bu[i]).sum::<Vec3>();
                (0..4).map(|j| row(j) * bv[j]).sum::<Vec3>()
            };
            SurfacePoint { position: sum(bu, bv), dpdu: sum(du, bv), dpdv: sum(bu, dv), uv: bilinear(&patch.uvs, u, v) }
        });
    }
    data
}

/// Tessellates bilinear patches of 2 x 2 control points.
pub fn bilinear_mesh(patches: &[Patch<4>]) -> MeshData {
    let mut data = MeshData::default();
    for patch in patches {
        let [a, b, c, d] = patch.points;
        let flat = (b - a).cross(c - a).dot(d - a) == 0.0 && a + d == b + c;
        let steps = if flat { 1 } else { BILINEAR_STEPS };
        tessellate(&mut data, [steps; 2], |u, v| SurfacePoint {
            position: a.lerp(b, u).lerp(c.lerp(d, u), v),
            dpdu: (b - a).lerp(d - c, v),
            dpdv: (c - a).lerp(d - b, u),
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

    /// The control points of a basis that reproduce the polynomial t^k, by its blossom.
    fn control(name: &str, k: i32, i: usize) -> f32 {
        let power = |t: f32| t.powi(k);
        match name {
            // The polar form of t^k at (0,0,0), (0,0,1), (0,1,1), (1,1,1), or the knots around 0..1
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
        // Terms of the surface: power of u, power of v, coefficient.
        let terms = [
            (1, 0, Vec3::new(1.0, 0.0, 0.3)),
            (0, 2, Vec3::new(0.2, 0.0, 0.0)),
            (0, 1, Vec3::Y),
            (3, 0, Vec3::new(0.0, -0.1, 0.0)),
            (2, 1, Vec3::Z),
            (0, 3, -Vec3::Z),
        ];
        for name in ["bezier", "b-spline", "hermite", "power"] {
            let basis = Basis::by_name(name).unwrap();
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
        assert_eq!(rom, Vec4::Y, "interpolates its control points");
        assert!((Basis::CATMULL_ROM.weights(0.3)[0].element_sum() - 1.0).abs() < 1e-6);
        assert!(Basis::by_name("spline").is_err());
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
