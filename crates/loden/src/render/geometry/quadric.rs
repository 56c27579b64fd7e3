//! The quadrics of the RenderMan Interface.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Vec2, Vec3};

use super::{SurfacePoint, frame};
use crate::{Error, Result};

/// A surface of revolution about the z axis. Angles are in degrees; lengths in the object's units.
///
/// # Model
/// P(u, v): u = 0..1 sweeps around the axis by `sweep`, v follows the profile. The outside is the side of dP/du x
/// dP/dv. [`super::super::Revolved`] intersects it with rays.
///
/// # References
/// pixar2000 (section 5.2 and the figures there)
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quadric {
    /// A sphere between the heights `z_min` and `z_max`.
    Sphere {
        /// Radius.
        radius: f32,
        /// Lowest height, at v = 0.
        z_min: f32,
        /// Greatest height, at v = 1.
        z_max: f32,
        /// Angle of revolution.
        sweep: f32,
    },
    /// A cone with its base at z = 0.
    Cone {
        /// Height of the apex.
        height: f32,
        /// Radius at z = 0.
        radius: f32,
        /// Angle of revolution.
        sweep: f32,
    },
    /// A cylinder without caps.
    Cylinder {
        /// Radius.
        radius: f32,
        /// Height at v = 0.
        z_min: f32,
        /// Height at v = 1.
        z_max: f32,
        /// Angle of revolution.
        sweep: f32,
    },
    /// A hyperboloid: the segment from `from` to `to`, revolved.
    Hyperboloid {
        /// Start of the segment, at v = 0.
        from: Vec3,
        /// End of the segment, at v = 1.
        to: Vec3,
        /// Angle of revolution.
        sweep: f32,
    },
    /// A paraboloid: z = `z_max` (r / `r_max`)^2.
    Paraboloid {
        /// Radius at `z_max`.
        r_max: f32,
        /// Height at v = 0.
        z_min: f32,
        /// Height at v = 1.
        z_max: f32,
        /// Angle of revolution.
        sweep: f32,
    },
    /// A disk; v runs from the edge to the centre.
    Disk {
        /// Height of the disk.
        height: f32,
        /// Radius.
        radius: f32,
        /// Angle of revolution.
        sweep: f32,
    },
    /// A torus around z.
    Torus {
        /// Distance from the axis to the centre of the tube.
        major_radius: f32,
        /// Radius of the tube.
        minor_radius: f32,
        /// Start of the tube's arc; 0 is outwards, 90 is +z.
        phi_min: f32,
        /// End of the tube's arc.
        phi_max: f32,
        /// Angle of revolution.
        sweep: f32,
    },
}

impl Quadric {
    /// The surface at u and v in 0..1.
    pub(in crate::render) fn at(&self, u: f32, v: f32) -> SurfacePoint {
        let sweep = self.sweep().to_radians();
        let turn = if u == 1.0 && sweep.abs() == TAU { Vec2::X } else { Vec2::from_angle(u * sweep) };
        self.turned(&self.outline(v), turn, Vec2::new(u, v))
    }

    /// A point of the profile, rotated from the x axis to a unit vector. `uv` are the parameters of the point.
    pub(in crate::render) fn turned(&self, outline: &Outline, Vec2 { x: cos, y: sin }: Vec2, uv: Vec2) -> SurfacePoint {
        let turn = |p: Vec3| Vec3::new(p.x * cos - p.y * sin, p.x * sin + p.y * cos, p.z);
        let position = turn(outline.position);
        // On the axis, dP/du has the direction of a point nearby.
        let beside = if outline.position.truncate().length() > 1e-6 * outline.position.length().max(1e-30) {
            position
        } else {
            turn(outline.slope * if uv.y > 0.5 { -1.0 } else { 1.0 })
        };
        let dpdu = Vec3::new(-beside.y, beside.x, 0.0) * self.sweep().signum();
        SurfacePoint { position, dpdu, dpdv: turn(outline.slope), uv }
    }

    /// Unit normal and tangent dP/du at a point; at an apex those of a point nearby.
    pub(in crate::render) fn frame(&self, at: &SurfacePoint) -> (Vec3, Vec3) {
        let inwards = |x: f32| x + 1e-3 * (0.5 - x);
        let near = || frame(&self.at(inwards(at.uv.x), inwards(at.uv.y)));
        frame(at).or_else(near).unwrap_or((Vec3::Z, Vec3::X))
    }

    /// Angle of revolution, degrees.
    pub(in crate::render) fn sweep(&self) -> f32 {
        match *self {
            Self::Sphere { sweep, .. }
            | Self::Cone { sweep, .. }
            | Self::Cylinder { sweep, .. }
            | Self::Hyperboloid { sweep, .. }
            | Self::Paraboloid { sweep, .. }
            | Self::Disk { sweep, .. }
            | Self::Torus { sweep, .. } => sweep,
        }
    }

    /// The profile that is revolved, at v.
    pub(in crate::render) fn outline(&self, v: f32) -> Outline {
        let plane = |x: f32, z: f32| Vec3::new(x, 0.0, z);
        let mix = |a: f32, b: f32| a + v * (b - a);
        match *self {
            Self::Sphere { radius, z_min, z_max, .. } => {
                let angle = |z: f32| (z / radius).clamp(-1.0, 1.0).asin();
                let phi = mix(angle(z_min), angle(z_max));
                let turned = (angle(z_max) - angle(z_min)) * radius;
                // Place a pole exactly on the axis.
                let (sin, cos) = if phi.abs() > FRAC_PI_2 - 1e-6 { (phi.signum(), 0.0) } else { phi.sin_cos() };
                Outline { position: plane(cos, sin) * radius, slope: plane(-sin, cos) * turned }
            }
            Self::Cone { height, radius, .. } => {
                Outline { position: plane(radius * (1.0 - v), height * v), slope: plane(-radius, height) }
            }
            Self::Cylinder { radius, z_min, z_max, .. } => {
                Outline { position: plane(radius, mix(z_min, z_max)), slope: plane(0.0, z_max - z_min) }
            }
            Self::Hyperboloid { from, to, .. } => Outline { position: from.lerp(to, v), slope: to - from },
            Self::Paraboloid { r_max, z_min, z_max, .. } => {
                let z = mix(z_min, z_max);
                let r = r_max * (z / z_max).max(0.0).sqrt();
                // dr/dz = r_max^2 / (2 z_max r); multiply by r to keep the apex finite.
                let slope = plane(0.5 * r_max * r_max / z_max, r) * (z_max - z_min);
                Outline { position: plane(r, z), slope }
            }
            Self::Disk { height, radius, .. } => {
                Outline { position: plane(radius * (1.0 - v), height), slope: plane(-radius, 0.0) }
            }
            Self::Torus { major_radius, minor_radius, phi_min, phi_max, .. } => {
                let (sin, cos) = mix(phi_min, phi_max).to_radians().sin_cos();
                let turned = (phi_max - phi_min).to_radians() * minor_radius;
                let position = plane(major_radius + minor_radius * cos, minor_radius * sin);
                Outline { position, slope: plane(-sin, cos) * turned }
            }
        }
    }

    /// Checks the parameters.
    ///
    /// # Errors
    /// [`Error::Parameter`] if a parameter is not finite or above 1e12, or if the surface has no area.
    pub fn check(&self) -> Result<()> {
        let bad = |what: &str| Err(Error::parameter("quadric", format!("{what}: {self:?}")));
        let numbers: &[f32] = match self {
            Self::Sphere { radius, z_min, z_max, sweep } => &[*radius, *z_min, *z_max, *sweep],
            Self::Cone { height, radius, sweep } => &[*height, *radius, *sweep],
            Self::Cylinder { radius, z_min, z_max, sweep } => &[*radius, *z_min, *z_max, *sweep],
            Self::Hyperboloid { from, to, sweep } => &[from.length(), to.length(), *sweep],
            Self::Paraboloid { r_max, z_min, z_max, sweep } => &[*r_max, *z_min, *z_max, *sweep],
            Self::Disk { height, radius, sweep } => &[*height, *radius, *sweep],
            Self::Torus { major_radius, minor_radius, phi_min, phi_max, sweep } => {
                &[*major_radius, *minor_radius, *phi_min, *phi_max, *sweep]
            }
        };
        if numbers.iter().any(|x| !x.is_finite() || x.abs() > 1e12) {
            return bad("a parameter is not finite or too large");
        }
        let flat = match *self {
            Self::Sphere { radius, z_min, z_max, .. } => {
                radius == 0.0 || z_min.clamp(-radius.abs(), radius.abs()) == z_max.clamp(-radius.abs(), radius.abs())
            }
            Self::Cone { height, radius, .. } => radius == 0.0 && height == 0.0,
            Self::Cylinder { radius, z_min, z_max, .. } => radius == 0.0 || z_min == z_max,
            Self::Hyperboloid { from, to, .. } => from == to,
            Self::Paraboloid { r_max, z_min, z_max, .. } => r_max == 0.0 || z_max == 0.0 || z_min == z_max,
            Self::Disk { radius, .. } => radius == 0.0,
            Self::Torus { minor_radius, phi_min, phi_max, .. } => minor_radius == 0.0 || phi_min == phi_max,
        };
        if flat || self.sweep() == 0.0 {
            return bad("the surface has no area");
        }
        Ok(())
    }
}

/// A point of the profile, at u = 0, and its derivative by v.
pub(in crate::render) struct Outline {
    pub position: Vec3,
    pub slope: Vec3,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<Quadric> {
        let sweep = 360.0;
        vec![
            Quadric::Sphere { radius: 2.0, z_min: -2.0, z_max: 2.0, sweep },
            Quadric::Sphere { radius: 2.0, z_min: -1.0, z_max: 1.5, sweep: 200.0 },
            Quadric::Cone { height: 2.0, radius: 1.0, sweep },
            Quadric::Cylinder { radius: 0.5, z_min: -1.0, z_max: 2.0, sweep: 90.0 },
            Quadric::Hyperboloid { from: Vec3::new(1.0, 0.0, -1.0), to: Vec3::new(0.0, 1.0, 1.0), sweep },
            Quadric::Paraboloid { r_max: 1.5, z_min: 0.0, z_max: 2.0, sweep },
            Quadric::Disk { height: 0.3, radius: 1.2, sweep },
            Quadric::Torus { major_radius: 2.0, minor_radius: 0.5, phi_min: 0.0, phi_max: 360.0, sweep },
        ]
    }

    /// Zero on the surface; approximately the distance elsewhere.
    fn implicit(quadric: &Quadric, p: Vec3) -> f32 {
        let r = p.truncate().length();
        match *quadric {
            Quadric::Sphere { radius, .. } => p.length() - radius,
            Quadric::Cone { height, radius, .. } => r - radius * (1.0 - p.z / height),
            Quadric::Cylinder { radius, .. } => r - radius,
            // r^2 at height z on the line from (1, 0, -1) to (0, 1, 1)
            Quadric::Hyperboloid { .. } => r * r - 0.5 * (1.0 + p.z * p.z),
            Quadric::Paraboloid { r_max, z_max, .. } => p.z - z_max * (r / r_max).powi(2),
            Quadric::Disk { height, .. } => p.z - height,
            Quadric::Torus { major_radius, minor_radius, .. } => {
                Vec2::new(r - major_radius, p.z).length() - minor_radius
            }
        }
    }

    #[test]
    fn points_lie_on_the_surface_with_its_normal() {
        for quadric in all() {
            for (i, j) in (0..=12).flat_map(|i| (0..=12).map(move |j| (i, j))) {
                let (u, v) = (i as f32 / 12.0, j as f32 / 12.0);
                let at = quadric.at(u, v);
                let (p, (n, t)) = (at.position, quadric.frame(&at));
                assert!(implicit(&quadric, p).abs() < 1e-5, "{quadric:?} {p}");
                assert!((n.length() - 1.0).abs() < 1e-5);
                assert!(t.dot(n).abs() < 1e-3 && (t.length() - 1.0).abs() < 1e-5, "{quadric:?} {p} {t} {n}");
                let e = 1e-2;
                let gradient =
                    [Vec3::X, Vec3::Y, Vec3::Z].map(|a| implicit(&quadric, p + e * a) - implicit(&quadric, p - e * a));
                // The normal is undefined at an apex.
                let Some(gradient) = Vec3::from(gradient).try_normalize() else { continue };
                if p.truncate().length() > 0.05 {
                    assert!(gradient.dot(n).abs() > 0.999, "{quadric:?} {p}: {gradient} {n}");
                }
            }
        }
    }

    #[test]
    fn the_outside_is_outside() {
        for k in [0, 1, 2, 3, 7] {
            let quadric = all()[k];
            for (i, j) in (0..=12).flat_map(|i| (0..=12).map(move |j| (i, j))) {
                let (u, v) = (i as f32 / 12.0, j as f32 / 12.0);
                let p = quadric.at(u, v).position;
                let outwards = match quadric {
                    Quadric::Torus { .. } => p - p.with_z(0.0).normalize() * 2.0,
                    _ => p,
                };
                assert!(outwards.dot(quadric.frame(&quadric.at(u, v)).0) > -1e-6, "{quadric:?} at {p}");
            }
        }
    }

    #[test]
    fn degenerate_quadrics_are_errors() {
        for quadric in [
            Quadric::Sphere { radius: 0.0, z_min: -1.0, z_max: 1.0, sweep: 360.0 },
            Quadric::Cylinder { radius: 1.0, z_min: 1.0, z_max: 1.0, sweep: 360.0 },
            Quadric::Disk { height: f32::NAN, radius: 1.0, sweep: 360.0 },
            Quadric::Cone { height: 1.0, radius: 1.0, sweep: 0.0 },
        ] {
            assert!(quadric.check().unwrap_err().to_string().contains("quadric"));
        }
    }
}
