//! What shapes wear until the lights of the world are known, and the material it then becomes.

use std::f32::consts::PI;
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::request::RibResult;
use crate::direction::cosine_hemisphere;
use crate::material::{Material, OneByOne, OwnLight, Point, Prepared, Promises, Sample};
use crate::model::{self, Analytic};
use crate::params::Values;
use crate::picture::Picture;

/// RenderMan's default surface: even and facing part of its shading, which needs no light.
const DEFAULT_SHADING: [f32; 2] = [0.2, 0.8];

/// What a shape wears.
pub(super) struct Shade {
    /// Name in error messages.
    pub name: String,
    pub kind: Kind,
    /// Fraction of light that does not pass straight through, per channel.
    pub opacity: Vec3,
}

pub(super) enum Kind {
    /// A measured material.
    Measured(Arc<dyn Material>),
    /// A surface shader.
    Shader(Look),
}

/// What a surface shader makes of light.
#[derive(Clone)]
pub(super) struct Look {
    pub base: Base,
    /// Its colour, for shading without any light.
    pub color: Vec3,
    /// Ka times the colour: the radiance under ambient light of 1.
    pub ambient: Vec3,
    /// Radiance whatever the light.
    pub constant: Vec3,
    /// Radiance that lights other surfaces.
    pub emitted: Vec3,
    /// Factor of all colours, by texture coordinates.
    pub paint: Option<Arc<Picture>>,
}

/// How a surface reflects light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Base {
    /// Lambertian.
    Matte { diffuse: Vec3 },
    /// RenderMan's diffuse() and specular().
    Plastic { diffuse: Vec3, specular: Vec3, roughness: f32 },
    /// A metal's reflectance at normal incidence, and the roughness of RenderMan's specular().
    Mirror { specular: Vec3, roughness: f32 },
}

impl Look {
    /// A matte look of a colour.
    pub(super) fn matte(diffuse: Vec3) -> Self {
        Self::of(Base::Matte { diffuse })
    }

    /// The look of a base whose ambient coefficient is its colour.
    pub(super) fn of(base: Base) -> Self {
        let color = match base {
            Base::Matte { diffuse } => diffuse,
            Base::Plastic { diffuse, specular, .. } => diffuse.max(specular),
            Base::Mirror { specular, .. } => specular,
        };
        let zero = Vec3::ZERO;
        Self { base, color, ambient: color, constant: zero, emitted: zero, paint: None }
    }

    /// A surface that reflects nothing and shows a colour.
    pub(super) fn constant(color: Vec3) -> Self {
        let base = Self::matte(Vec3::ZERO);
        Self { constant: color, color, ambient: Vec3::ZERO, ..base }
    }

    /// A surface that reflects nothing and emits light.
    pub(super) fn emitting(radiance: Vec3) -> Self {
        let base = Self::matte(Vec3::ZERO);
        Self { emitted: radiance, color: radiance, ambient: Vec3::ZERO, ..base }
    }

    /// Whether it is visible without any light.
    fn needs_no_light(&self) -> bool {
        self.constant != Vec3::ZERO || self.emitted != Vec3::ZERO
    }
}

impl Shade {
    /// Whether it lights other surfaces.
    pub(super) fn emits(&self) -> bool {
        matches!(&self.kind, Kind::Shader(look) if look.emitted != Vec3::ZERO)
    }

    /// Whether it is visible only if there is a light.
    pub(super) fn needs_light(&self) -> bool {
        match &self.kind {
            Kind::Measured(_) => true,
            Kind::Shader(look) => !look.needs_no_light(),
        }
    }

    /// The material in a world with this ambient light, and what opens it again ([`crate::render::scene_file::SceneMaterial::source`]). The light is `None`
    /// if the world has none at all.
    pub(super) fn material(&self, ambient: Option<Vec3>) -> RibResult<(Arc<dyn Material>, Option<String>)> {
        let opacity = self.opacity;
        let look = match &self.kind {
            Kind::Measured(material) => {
                // Without any light, a measured material is shown under light from everywhere.
                let ambient = ambient.unwrap_or(Vec3::ONE);
                if ambient == Vec3::ZERO && opacity == Vec3::ONE {
                    return Ok((material.clone(), Some(self.name.clone())));
                }
                return Ok((Arc::new(AmbientLit { material: material.clone(), ambient, opacity }), None));
            }
            Kind::Shader(look) => look,
        };
        let [even, facing] = match ambient {
            None if !look.needs_no_light() => DEFAULT_SHADING.map(|part| part * look.color),
            _ => [look.constant + ambient.unwrap_or(Vec3::ZERO) * look.ambient, Vec3::ZERO],
        };
        let (base, diffuse) = look.base.analytic()?;
        let (emitted, paint) = (look.emitted, look.paint.clone());
        let own = even != Vec3::ZERO || facing != Vec3::ZERO || emitted != Vec3::ZERO || opacity != Vec3::ONE;
        if own || paint.is_some() {
            return Ok((Arc::new(Shaded { base, diffuse, paint, even, facing, emitted, opacity, own }), None));
        }
        let source = base.specification();
        Ok((Arc::new(base), Some(source)))
    }
}

impl Base {
    /// The model, and its diffuse reflectance.
    ///
    /// # Model
    /// - Plastic is `blinn-phong` in its original form: RenderMan's specular() is (n.h)^(1 / roughness) without 1 / pi,
    ///   so ks = Ks times the colour / pi.
    /// - Mirror is `ggx` with a perfect mirror's reflectance and a highlight as wide as the roughness says.
    fn analytic(self) -> RibResult<(Analytic, Vec3)> {
        let limited = |c: Vec3, most: f32| c.clamp(Vec3::ZERO, Vec3::splat(most));
        let rgb = |c: Vec3| format!("{},{},{}", c.x, c.y, c.z);
        let exponent = |roughness: f32| (1.0 / roughness.max(1e-5)).min(100_000.0);
        let (model, values, diffuse) = match self {
            Self::Matte { diffuse } => {
                let diffuse = limited(diffuse, 1.0);
                ("lambert", vec![("kd", rgb(diffuse))], diffuse)
            }
            Self::Plastic { diffuse, specular, roughness } => {
                let diffuse = limited(diffuse, 1.0);
                let (ks, form) = (("ks", rgb(limited(specular / PI, 10.0))), ("form", "original".to_owned()));
                let exponent = ("exponent", exponent(roughness).to_string());
                ("blinn-phong", vec![("kd", rgb(diffuse)), ks, exponent, form], diffuse)
            }
            Self::Mirror { specular, roughness } => {
                // The variance of the slopes of a cosine power lobe.
                let alpha = (2.0 / (exponent(roughness) + 2.0)).sqrt().max(0.001).to_string();
                let (kd, mirror) = (("kd", rgb(Vec3::ZERO)), ("metal", "mirror".to_owned()));
                let ks = ("ks", rgb(limited(specular, 10.0)));
                ("ggx", vec![kd, ks, ("alpha-x", alpha.clone()), ("alpha-y", alpha), mirror], Vec3::ZERO)
            }
        };
        let model = model::by_name(model).map_err(|e| e.to_string())?;
        let values = Values::new(model.params(), values.iter().map(|(name, text)| (*name, text.as_str())));
        let made = values.and_then(|values| Analytic::new(model, values)).map_err(|e| e.to_string())?;
        Ok((made, diffuse))
    }
}

/// A surface shader under the lights of its world.
struct Shaded {
    base: Analytic,
    /// The base's diffuse reflectance.
    diffuse: Vec3,
    paint: Option<Arc<Picture>>,
    /// Shown radiance: even + facing cos^2 of the angle to the viewer.
    even: Vec3,
    facing: Vec3,
    emitted: Vec3,
    opacity: Vec3,
    own: bool,
}

impl Shaded {
    fn paint(&self, uv: Vec2) -> Vec3 {
        self.paint.as_ref().map_or(Vec3::ONE, |picture| color_at(picture, uv))
    }
}

impl Material for Shaded {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        let value = self.base.apparent(uv, wi, wo);
        if self.paint.is_none() || wi.z <= 0.0 || wo.z <= 0.0 {
            return value;
        }
        value + (self.paint(uv) - 1.0) * self.diffuse * wi.z
    }

    fn promises(&self) -> Promises {
        self.base.promises()
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        self.base.sample(uv, wo, random)
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        self.base.pdf(uv, wi, wo)
    }

    fn prepare<'a>(&'a self, points: &'a [Point]) -> Box<dyn Prepared + 'a> {
        match self.paint {
            None => self.base.prepare(points),
            Some(_) => Box::new(OneByOne { material: self, points }),
        }
    }

    fn only_reflects(&self) -> bool {
        !self.own
    }

    fn own(&self, uv: Vec2, wo: Vec3) -> OwnLight {
        let paint = self.paint(uv);
        let shown = (self.even + self.facing * (wo.z * wo.z)) * paint;
        OwnLight { emitted: self.emitted * paint, shown, opacity: self.opacity }
    }
}

/// A measured material that also reflects ambient light: light from everywhere that nothing keeps off.
struct AmbientLit {
    material: Arc<dyn Material>,
    ambient: Vec3,
    opacity: Vec3,
}

/// Directions from which ambient light is collected, along one axis of the random numbers.
const AMBIENT_STEPS: usize = 5;

impl Material for AmbientLit {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.material.apparent(uv, wi, wo)
    }

    fn promises(&self) -> Promises {
        self.material.promises()
    }

    fn texels(&self) -> Option<[usize; 2]> {
        self.material.texels()
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        self.material.sample(uv, wo, random)
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        self.material.pdf(uv, wi, wo)
    }

    fn prepare<'a>(&'a self, points: &'a [Point]) -> Box<dyn Prepared + 'a> {
        self.material.prepare(points)
    }

    fn only_reflects(&self) -> bool {
        false
    }

    fn own(&self, uv: Vec2, wo: Vec3) -> OwnLight {
        // The mean over cosine-distributed directions of the value over the cosine is the albedo.
        let place = |k: usize| (k as f32 + 0.5) / AMBIENT_STEPS as f32;
        let cells = (0..AMBIENT_STEPS * AMBIENT_STEPS).map(|k| (place(k % AMBIENT_STEPS), place(k / AMBIENT_STEPS)));
        let value = |(x, y)| {
            let wi = cosine_hemisphere(Vec2::new(x, y));
            self.material.apparent(uv, wi, wo) / wi.z.max(0.01)
        };
        let albedo = cells.map(value).sum::<Vec3>() / (AMBIENT_STEPS * AMBIENT_STEPS) as f32;
        OwnLight { emitted: Vec3::ZERO, shown: albedo * self.ambient, opacity: self.opacity }
    }

    fn check(&self) -> crate::Result<()> {
        self.material.check()
    }
}

/// The colour of a repeating picture, interpolated bilinearly; v points up.
fn color_at(picture: &Picture, uv: Vec2) -> Vec3 {
    let (w, h) = (picture.width, picture.height);
    let (x, y) = (uv.x * w as f32 - 0.5, (1.0 - uv.y) * h as f32 - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let (s, t) = (x - x0, y - y0);
    let at = |x: f32, y: f32| {
        picture.rgb[(y as i64).rem_euclid(h as i64) as usize * w + (x as i64).rem_euclid(w as i64) as usize]
    };
    at(x0, y0).lerp(at(x0 + 1.0, y0), s).lerp(at(x0, y0 + 1.0).lerp(at(x0 + 1.0, y0 + 1.0), s), t)
}
