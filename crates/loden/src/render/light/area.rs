//! Area lights.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::Arriving;
use crate::direction::{Frame, concentric_disk};
use crate::picture::Picture;
use crate::render::ray::Ray;
use crate::render::shape::Sphere;
use crate::render::traced::Closed;
use crate::{Error, Result};

/// An area light: a surface that emits light and reflects nothing.
///
/// # Limits
/// A textured light is sampled uniformly, whatever its texture: small bright spots cause noise.
#[derive(Debug, Clone, PartialEq)]
pub struct AreaLight {
    /// Shape of the light.
    pub shape: Emitter,
    /// Emitted radiance, per channel.
    pub radiance: Vec3,
    /// Factors of the radiance over the surface; see [`AreaLight::with_texture`].
    texture: Option<Arc<Picture>>,
}

/// The shape of an area light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Emitter {
    /// A parallelogram, lit on one side.
    Rectangle(Flat),
    /// A disk or ellipse, lit on one side.
    Disk(Flat),
    /// A sphere, lit on the outside.
    Sphere {
        /// Centre, in world coordinates.
        centre: Vec3,
        /// Radius.
        radius: f32,
    },
}

/// The frame of a flat light: centre + a x + b y with a and b in -1..1. The lit side is that of x cross y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flat {
    /// Centre, in world coordinates.
    pub centre: Vec3,
    /// Vector from the centre to the edge.
    pub x: Vec3,
    /// Vector from the centre to the edge in another direction.
    pub y: Vec3,
}

impl Flat {
    /// The normal, with a quarter of the parallelogram's area as its length.
    #[inline]
    fn area_vector(&self) -> Vec3 {
        self.x.cross(self.y)
    }

    /// The intersection of a ray with the plane, from either side: distance and coordinates (a, b).
    #[inline]
    fn meet(&self, ray: &Ray) -> Option<(f32, Vec2)> {
        let n = self.area_vector();
        let t = (self.centre - ray.origin).dot(n) / ray.direction.dot(n);
        (t > 0.0 && t.is_finite()).then(|| (t, self.coordinates(ray.origin + ray.direction * t)))
    }

    /// The coordinates (a, b) of a point of the plane.
    #[inline]
    fn coordinates(&self, point: Vec3) -> Vec2 {
        let (n, p) = (self.area_vector(), point - self.centre);
        Vec2::new(p.cross(self.y).dot(n), self.x.cross(p).dot(n)) / n.length_squared()
    }

    /// Light of unit radiance that arrives from the point (a, b), drawn uniformly from `area`.
    #[inline]
    fn arriving(&self, at: Vec3, ab: Vec2, area: f32) -> Option<Arriving> {
        let to_light = self.centre + self.x * ab.x + self.y * ab.y - at;
        let distance = to_light.length();
        let direction = to_light.try_normalize()?;
        let cosine = -direction.dot(self.area_vector().try_normalize()?);
        let pdf = distance * distance / (area * cosine);
        (cosine > 0.0 && pdf > 0.0 && pdf.is_finite()).then(|| Arriving {
            direction,
            distance,
            irradiance: Vec3::splat(1.0 / pdf),
            pdf,
        })
    }
}

impl Emitter {
    /// Surface area.
    pub fn area(&self) -> f32 {
        match self {
            Self::Rectangle(flat) => 4.0 * flat.area_vector().length(),
            Self::Disk(flat) => PI * flat.area_vector().length(),
            Self::Sphere { radius, .. } => 4.0 * PI * radius * radius,
        }
    }

    /// Position of a surface point in the texture: right and down, 0..1.
    fn place(&self, point: Vec3) -> Vec2 {
        match self {
            Self::Rectangle(flat) | Self::Disk(flat) => flat.coordinates(point) * Vec2::new(0.5, -0.5) + 0.5,
            Self::Sphere { centre, .. } => {
                let n = point - *centre;
                Vec2::new(0.5 + n.x.atan2(n.z) / TAU, n.with_y(0.0).length().atan2(n.y) / PI)
            }
        }
    }

    /// The nearest intersection with 0 < t < `t_max`, from either side.
    #[inline]
    pub(in crate::render) fn closest(&self, ray: &Ray, t_max: f32) -> Option<f32> {
        let within = |t: f32| t < t_max;
        match self {
            Self::Rectangle(flat) => flat.meet(ray).filter(|(t, p)| within(*t) && p.abs().max_element() <= 1.0),
            Self::Disk(flat) => flat.meet(ray).filter(|(t, p)| within(*t) && p.length_squared() <= 1.0),
            Self::Sphere { centre, radius } => {
                let t = Sphere { centre: *centre, radius: *radius, axis: Vec3::Y }.distance(ray, t_max);
                return t.is_finite().then_some(t);
            }
        }
        .map(|(t, _)| t)
    }
}

impl AreaLight {
    /// Whether a picture multiplies its radiance.
    pub fn is_textured(&self) -> bool {
        self.texture.is_some()
    }

    /// A light of constant radiance.
    pub fn new(shape: Emitter, radiance: Vec3) -> Self {
        Self { shape, radiance, texture: None }
    }

    /// Multiplies the radiance by a picture, interpolated bilinearly. On a flat light, x points to the right and y up
    /// in the picture, seen from the lit side. A sphere has the poles of a latitude-longitude picture at +y and -y and
    /// its middle column towards +z.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a picture without pixels or with values that are negative or not finite.
    pub fn with_texture(self, texture: Picture) -> Result<Self> {
        let bad = |c: &Vec3| !c.is_finite() || c.min_element() < 0.0;
        if texture.rgb.is_empty() || texture.rgb.len() != texture.width * texture.height {
            return Err(Error::parameter("texture", "the picture has no pixels"));
        }
        if let Some(i) = texture.rgb.iter().position(bad) {
            let (x, y) = (i % texture.width, i / texture.width);
            let problem = format!("pixel ({x}, {y}) is {}, expected finite values of at least 0", texture.rgb[i]);
            return Err(Error::parameter("texture", problem));
        }
        Ok(Self { texture: Some(texture.into()), ..self })
    }

    /// The radiance at a point of the surface.
    #[inline]
    fn radiance_at(&self, point: Vec3) -> Vec3 {
        match &self.texture {
            None => self.radiance,
            Some(texture) => self.radiance * interpolated(texture, self.shape.place(point)),
        }
    }

    /// Draws a point on the light: a sphere uniformly in solid angle, other shapes uniformly in area.
    #[inline]
    pub(super) fn arriving(&self, at: Vec3, random: Vec2) -> Option<Arriving> {
        let one = match &self.shape {
            Emitter::Rectangle(flat) => flat.arriving(at, 2.0 * random - Vec2::ONE, self.shape.area()),
            Emitter::Disk(flat) => flat.arriving(at, concentric_disk(random), self.shape.area()),
            Emitter::Sphere { centre, radius } => from_sphere(at, *centre, *radius, random),
        }?;
        Some(Arriving { irradiance: one.irradiance * self.radiance_at(at + one.direction * one.distance), ..one })
    }

    /// The radiance that a ray sees where it hits the light at `t`, and the density, 1/sr, with which
    /// [`AreaLight::arriving`] draws the direction.
    #[inline]
    pub(in crate::render) fn seen(&self, ray: &Ray, t: f32) -> (Vec3, f32) {
        let radiance = self.radiance_at(ray.origin + ray.direction * t);
        match &self.shape {
            Emitter::Rectangle(flat) | Emitter::Disk(flat) => {
                let cosine = -ray.direction.dot(flat.area_vector().normalize_or_zero());
                if cosine > 0.0 { (radiance, t * t / (self.shape.area() * cosine)) } else { (Vec3::ZERO, 0.0) }
            }
            Emitter::Sphere { centre, radius } => match cap(ray.origin, *centre, *radius) {
                Some(height) => (radiance, 1.0 / (TAU * height)),
                None => (Vec3::ZERO, 0.0),
            },
        }
    }
}

/// The bilinearly interpolated value of a picture; the pixels at its edges continue.
fn interpolated(picture: &Picture, at: Vec2) -> Vec3 {
    let last = Vec2::new(picture.width as f32, picture.height as f32) - 1.0;
    let p = (at * (last + 1.0) - 0.5).clamp(Vec2::ZERO, last);
    let (low, part) = (p.floor(), p - p.floor());
    let high = (low + 1.0).min(last);
    let row = |y: f32| {
        let pixel = |x: f32| picture.at(x as usize, y as usize);
        pixel(low.x).lerp(pixel(high.x), part.x)
    };
    row(low.y).lerp(row(high.y), part.y)
}

/// 1 - cos of the half angle that a sphere subtends; `None` from inside.
#[inline]
fn cap(at: Vec3, centre: Vec3, radius: f32) -> Option<f32> {
    let sine2 = radius * radius / at.distance_squared(centre);
    (sine2 < 1.0).then(|| sine2 / (1.0 + (1.0 - sine2).sqrt()))
}

/// Draws a direction towards a sphere of unit radiance, uniformly in solid angle.
///
/// # References
/// shirley1996 (section 3.2)
#[inline]
fn from_sphere(at: Vec3, centre: Vec3, radius: f32, random: Vec2) -> Option<Arriving> {
    let height = cap(at, centre, radius)?;
    let to_centre = centre - at;
    let distance = to_centre.length();
    let frame = Frame::from_normal(to_centre / distance);
    // 1 - cos theta, which keeps its precision for small angles
    let h = height * random.x;
    let sine = (h * (2.0 - h)).max(0.0).sqrt();
    let (sin_phi, cos_phi) = (TAU * random.y).sin_cos();
    let direction = frame.world(Vec3::new(sine * cos_phi, sine * sin_phi, 1.0 - h)).normalize();
    // Compute the distance to the sphere along the direction
    let beside = distance * sine;
    let t = distance * (1.0 - h) - (radius * radius - beside * beside).max(0.0).sqrt();
    let pdf = 1.0 / (TAU * height);
    pdf.is_finite().then_some(Arriving { direction, distance: t, irradiance: Vec3::splat(TAU * height), pdf })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lights() -> [Emitter; 3] {
        let flat =
            Flat { centre: Vec3::new(0.3, 2.0, -0.2), x: Vec3::new(0.7, 0.1, 0.0), y: Vec3::new(0.2, -0.3, 0.9) };
        // Make the light face down.
        let flat = if flat.area_vector().y > 0.0 { Flat { x: -flat.x, ..flat } } else { flat };
        [
            Emitter::Rectangle(flat),
            Emitter::Disk(flat),
            Emitter::Sphere { centre: Vec3::new(0.5, 2.0, 0.4), radius: 0.8 },
        ]
    }

    /// The centres of n x n cells of the unit square.
    fn grid(n: usize) -> impl Iterator<Item = Vec2> {
        (0..n * n).map(move |i| Vec2::new((i % n) as f32 + 0.5, (i / n) as f32 + 0.5) / n as f32)
    }

    #[test]
    fn irradiance_by_light_sampling_equals_that_by_hemisphere_sampling() {
        for shape in lights() {
            let light = AreaLight::new(shape, Vec3::ONE);
            let n = 700;
            let by_light: f64 = grid(n)
                .filter_map(|u| light.arriving(Vec3::ZERO, u))
                .map(|a| f64::from(a.irradiance.x * a.direction.y.max(0.0)))
                .sum();
            let up = |w: Vec3| Vec3::new(w.x, w.z, w.y);
            let by_hemisphere: f64 = grid(n)
                .map(|u| Ray { origin: Vec3::ZERO, direction: up(crate::direction::cosine_hemisphere(u)) })
                .filter_map(|ray| Some(light.seen(&ray, shape.closest(&ray, f32::INFINITY)?).0))
                .map(|seen| f64::from(seen.x * PI))
                .sum();
            assert!((by_light / by_hemisphere - 1.0).abs() < 0.005, "{shape:?}: {by_light} {by_hemisphere}");
        }
    }

    #[test]
    fn sampled_directions_hit_the_light_with_their_density() {
        for shape in lights() {
            let light = AreaLight::new(shape, Vec3::ONE);
            for drawn in grid(40).filter_map(|u| light.arriving(Vec3::new(0.1, -0.3, 0.2), u)) {
                let ray = Ray { origin: Vec3::new(0.1, -0.3, 0.2), direction: drawn.direction };
                let t = shape.closest(&ray, f32::INFINITY).unwrap();
                assert!((t - drawn.distance).abs() < 2e-3 * t, "{shape:?}");
                let (radiance, pdf) = light.seen(&ray, t);
                assert!(radiance == Vec3::ONE && (pdf / drawn.pdf - 1.0).abs() < 1e-3);
            }
        }
    }

    fn checks() -> Picture {
        let rgb = (0..48).map(|i| Vec3::new((i % 8) as f32, (i / 8) as f32, ((i * 5) % 7) as f32)).collect();
        Picture { width: 8, height: 6, rgb }
    }

    #[test]
    fn textured_lights_are_sampled_without_bias() {
        for shape in lights() {
            let light = AreaLight::new(shape, Vec3::ONE).with_texture(checks()).unwrap();
            let n = 700;
            let by_light: glam::DVec3 = grid(n)
                .filter_map(|u| light.arriving(Vec3::ZERO, u))
                .map(|a| (a.irradiance * a.direction.y.max(0.0)).as_dvec3())
                .sum();
            let up = |w: Vec3| Vec3::new(w.x, w.z, w.y);
            let by_hemisphere: glam::DVec3 = grid(n)
                .map(|u| Ray { origin: Vec3::ZERO, direction: up(crate::direction::cosine_hemisphere(u)) })
                .filter_map(|ray| Some(light.seen(&ray, shape.closest(&ray, f32::INFINITY)?).0))
                .map(|seen| (seen * PI).as_dvec3())
                .sum();
            assert!((by_light / by_hemisphere - 1.0).abs().max_element() < 0.006, "{shape:?}");
        }
    }

    #[test]
    fn textures_stand_upright_on_the_lit_side() {
        let seen = |shape: Emitter, at: Vec3, from: Vec3| {
            let light = AreaLight::new(shape, Vec3::splat(2.0)).with_texture(checks()).unwrap();
            let ray = Ray { origin: from, direction: (at - from).normalize() };
            light.seen(&ray, shape.closest(&ray, f32::INFINITY).unwrap()).0
        };
        let flat = Flat { centre: Vec3::Z, x: Vec3::X, y: Vec3::Y };
        // The middle of the second pixel from the left in the last row
        let at = Vec3::new(2.0 * 1.5 / 8.0 - 1.0, 2.0 * 0.5 / 6.0 - 1.0, 1.0);
        for shape in [Emitter::Rectangle(flat), Emitter::Disk(flat)] {
            let found = seen(
                shape,
                if matches!(shape, Emitter::Disk(_)) { at * Vec3::new(0.6, 0.6, 1.0) } else { at },
                Vec3::Z * 9.0,
            );
            let expected = if matches!(shape, Emitter::Disk(_)) { Vec2::new(2.0, 4.0) } else { Vec2::new(1.0, 5.0) };
            assert!((found.truncate() - 2.0 * expected).length() < 0.5, "{shape:?}: {found}");
        }
        let ball = Emitter::Sphere { centre: Vec3::ZERO, radius: 1.0 };
        let found = seen(ball, Vec3::new(0.3, 0.3, 0.9).normalize(), Vec3::Z * 5.0);
        assert!(found.x > 7.3 && found.y < 4.5, "to the right is right, up is up: {found}");
        let mut dark = checks();
        dark.rgb[9].y = -1.0;
        assert!(AreaLight::new(ball, Vec3::ONE).with_texture(dark).unwrap_err().to_string().contains("(1, 1)"));
    }

    #[test]
    fn the_unlit_side_is_dark() {
        for shape in lights() {
            let light = AreaLight::new(shape, Vec3::ONE);
            let Emitter::Sphere { centre, .. } = shape else {
                assert_eq!(light.arriving(Vec3::Y * 5.0, Vec2::splat(0.5)), None);
                let down = Ray { origin: Vec3::new(0.3, 5.0, -0.2), direction: -Vec3::Y };
                assert_eq!(light.seen(&down, shape.closest(&down, 9.0).unwrap()).0, Vec3::ZERO);
                continue;
            };
            assert_eq!(light.arriving(centre, Vec2::splat(0.5)), None);
        }
    }
}
