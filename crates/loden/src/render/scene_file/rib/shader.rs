//! RenderMan's standard lights and surfaces as ours.

use std::f32::consts::PI;

use glam::{Mat4, Vec3};

use super::request::{Checked, Parameters};
use crate::model::{self, Analytic};
use crate::params::Values;
use crate::render::{DirectionalLight, Light, PointLight, SpotLight};

/// A light source.
pub(super) enum Source {
    /// The same radiance from everywhere.
    Ambient(Vec3),
    Light(Light),
}

/// A standard light; none if there is no such.
///
/// # Model
/// Lights that read shadow maps are those without: shadows are traced. The interface's surfaces reflect Kd times the light's colour, without 1 / pi: the irradiance is pi times it.
pub(super) fn light(name: &str, parameters: &Parameters, world_from_shader: Mat4) -> Checked<Option<Source>> {
    let color = parameters.number("intensity", 1.0) * parameters.triple("lightcolor", Vec3::ONE);
    if !color.is_finite() || color.min_element() < 0.0 {
        return Err(format!("intensity times lightcolor is {color}"));
    }
    let (from, to) = (parameters.triple("from", Vec3::ZERO), parameters.triple("to", Vec3::Z));
    let position = world_from_shader.transform_point3(from);
    let axis = || {
        let axis = world_from_shader.transform_point3(to) - position;
        axis.try_normalize().ok_or_else(|| format!("it shines from {from} to {to}"))
    };
    let degrees = |name: &str, default: f32| {
        let angle = parameters.number(name, default.to_radians()).to_degrees();
        if (0.0..=180.0).contains(&angle) { Ok(angle) } else { Err(format!("{name} is {angle} degrees")) }
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

/// A standard surface of a colour; none if there is no such.
///
/// # Model
/// - matte is `lambert` with kd = Kd Cs.
/// - metal and plastic are `blinn-phong` in its original form: the interface's specular() is (n.h)^(1 / roughness)
///   without 1 / pi, so ks = Ks times the colour / pi.
/// - shinymetal is `ggx` with the reflectance of a mirror, ks = Kr Cs and the width of the highlight of its roughness.
///
/// # Limits
/// Ka has no place: ambient light is light from all around, reflected as any other.
///
/// # References
/// pixar2000 (appendix A.1)
pub(super) fn surface(name: &str, parameters: &Parameters, color: Vec3) -> Checked<Option<Analytic>> {
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
            // the slopes' variance of a power of the cosine
            let alpha = (2.0 / (exponent + 2.0)).sqrt().max(0.001).to_string();
            let mirror = ("metal", "mirror".to_owned());
            let ks = ("ks", rgb(number("Kr", 1.0) * color, 10.0));
            ("ggx", vec![diffuse(Vec3::ZERO), ks, ("alpha-x", alpha.clone()), ("alpha-y", alpha), mirror])
        }
        _ => return Ok(None),
    };
    let model = model::by_name(model).map_err(|e| e.to_string())?;
    let values = Values::new(model.params(), values.iter().map(|(name, text)| (*name, text.as_str())));
    Ok(Some(Analytic::new(model, values.map_err(|e| e.to_string())?)))
}
