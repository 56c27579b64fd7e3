//! RenderMan's standard light and surface shaders as lights and materials of this library.

use std::f32::consts::PI;

use glam::{Mat4, Vec3};

use super::request::{Parameters, RibResult};
use crate::model::{self, Analytic};
use crate::params::Values;
use crate::render::{DirectionalLight, Light, PointLight, SpotLight};

/// A light source shader.
pub(super) enum Source {
    /// Constant radiance from all directions.
    Ambient(Vec3),
    Light(Light),
}

/// The light of a standard shader; `None` for other names.
///
/// # Model
/// RenderMan's surfaces reflect Kd times the light's colour, without 1 / pi, so the irradiance is pi times that colour.
/// Shaders that read shadow maps equal those that do not: shadows are ray traced.
pub(super) fn light(name: &str, parameters: &Parameters, world_from_shader: Mat4) -> RibResult<Option<Source>> {
    let color = emitted(parameters)?;
    let (from, to) = (parameters.triple("from", Vec3::ZERO), parameters.triple("to", Vec3::Z));
    let position = world_from_shader.transform_point3(from);
    let axis = || {
        let axis = world_from_shader.transform_point3(to) - position;
        axis.try_normalize().ok_or_else(|| format!("from {from} and to {to} are the same point"))
    };
    let degrees = |name: &str, default: f32| {
        let angle = parameters.number(name, default.to_radians()).to_degrees();
        if (0.0..=180.0).contains(&angle) {
            Ok(angle)
        } else {
            Err(format!("{name}: found {angle} degrees, expected 0 to 180"))
        }
    };
    Ok(Some(match name {
        "ambientlight" => Source::Ambient(color),
        "distantlight" | "shadowdistant" => {
            Source::Light(DirectionalLight { direction: -axis()?, irradiance: PI * color, radius_degrees: 0.0 }.into())
        }
        "pointlight" | "shadowpoint" => Source::Light(Light::Point(PointLight { position, intensity: PI * color })),
        "spotlight" | "shadowspot" => Source::Light(Light::Spot(SpotLight {
            position,
            axis: axis()?,
            intensity: PI * color,
            angle_degrees: degrees("coneangle", 30.0)?,
            edge_degrees: degrees("conedeltaangle", 5.0)?,
            falloff: parameters.number("beamdistribution", 2.0).max(0.0),
        })),
        _ => return Ok(None),
    }))
}

/// `intensity` times `lightcolor` of a light source shader.
pub(super) fn emitted(parameters: &Parameters) -> RibResult<Vec3> {
    let color = parameters.number("intensity", 1.0) * parameters.triple("lightcolor", Vec3::ONE);
    if !color.is_finite() || color.min_element() < 0.0 {
        return Err(format!("intensity times lightcolor: found {color}, expected finite values of at least 0"));
    }
    Ok(color)
}

/// The material of a standard shader and a colour; `None` for other names.
///
/// # Model
/// - matte is `lambert` with kd = Kd Cs.
/// - metal and plastic are `blinn-phong` in its original form: RenderMan's specular() is (n.h)^(1 / roughness)
///   without 1 / pi, so ks = Ks times the colour / pi.
/// - shinymetal is `ggx` with a perfect mirror's reflectance, ks = Kr Cs, and a highlight as wide as `roughness` says.
///
/// # Limits
/// Ka is ignored: ambient light is light from all directions and is reflected like any other.
///
/// # References
/// pixar2000 (appendix A.1)
pub(super) fn surface(name: &str, parameters: &Parameters, color: Vec3) -> RibResult<Option<Analytic>> {
    let number = |name: &str, default: f32| parameters.number(name, default).max(0.0);
    let exponent = (1.0 / number("roughness", 0.1).max(1e-5)).min(100_000.0);
    let rgb = |c: Vec3, most: f32| {
        let c = c.clamp(Vec3::ZERO, Vec3::splat(most));
        format!("{},{},{}", c.x, c.y, c.z)
    };
    let diffuse = |c: Vec3| ("kd", rgb(c, 1.0));
    let original = |kd: Vec3, ks: Vec3| {
        let form = ("form", "original".to_owned());
        ("blinn-phong", vec![diffuse(kd), ("ks", rgb(ks / PI, 10.0)), ("exponent", exponent.to_string()), form])
    };
    let (model, values) = match name {
        "matte" => ("lambert", vec![diffuse(number("Kd", 1.0) * color)]),
        "metal" => original(Vec3::ZERO, number("Ks", 1.0) * color),
        "plastic" => {
            let highlight = number("Ks", 0.5) * parameters.triple("specularcolor", Vec3::ONE);
            original(number("Kd", 0.5) * color, highlight)
        }
        "shinymetal" => {
            // The variance of the slopes of a cosine power lobe.
            let alpha = (2.0 / (exponent + 2.0)).sqrt().max(0.001).to_string();
            let mirror = ("metal", "mirror".to_owned());
            let ks = ("ks", rgb(number("Kr", 1.0) * color, 10.0));
            ("ggx", vec![diffuse(Vec3::ZERO), ks, ("alpha-x", alpha.clone()), ("alpha-y", alpha), mirror])
        }
        _ => return Ok(None),
    };
    let model = model::by_name(model).map_err(|e| e.to_string())?;
    let values = Values::new(model.params(), values.iter().map(|(name, text)| (*name, text.as_str())));
    values.and_then(|values| Analytic::new(model, values)).map(Some).map_err(|e| e.to_string())
}
