//! Light shaders as lights of this library: RenderMan's standard ones, others by their names and parameters, and those
//! of the newer interface.

use std::f32::consts::PI;

use glam::{Mat4, Vec3};

use super::request::{Parameters, RibResult};
use crate::render::{AreaLight, DirectionalLight, Emitter, Flat, Light, PointLight, SpotLight};

/// What a light shader becomes.
pub(super) enum Source {
    /// Ambient light: radiance from all directions that nothing keeps off.
    Ambient(Vec3),
    /// An environment, with the name of its picture.
    Sky(Vec3, Option<String>),
    /// A light, and whether it asks for shadows itself.
    Light { light: Light, decay: Decay, shadows: bool },
    /// The shapes that follow emit this radiance.
    Shapes(Vec3),
    /// Nothing.
    Off,
}

/// How the light of a point falls off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Decay {
    /// With the square of the distance.
    Square,
    /// Not at all.
    None,
    /// As is unknown: with the square of the distance if the scene is not dark then.
    Unknown,
}

/// The kinds of the standard light shaders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Ambient,
    Sky,
    Distant,
    Point,
    Spot,
}

impl Kind {
    fn name(self) -> &'static str {
        match self {
            Self::Ambient => "ambientlight",
            Self::Sky => "a constant environment",
            Self::Distant => "distantlight",
            Self::Point => "pointlight",
            Self::Spot => "spotlight",
        }
    }

    /// The kind of a standard shader, or of one that is called like one.
    fn standard(name: &str) -> Option<Self> {
        Some(match name {
            "ambientlight" => Self::Ambient,
            "distantlight" | "shadowdistant" => Self::Distant,
            "pointlight" | "shadowpoint" => Self::Point,
            "spotlight" | "shadowspot" => Self::Spot,
            _ => return None,
        })
    }

    /// The kind that is nearest to a shader by its name and parameters.
    fn nearest(name: &str, parameters: &Parameters) -> Self {
        let name = name.to_lowercase();
        let has = |names: &[&str]| names.iter().any(|name| parameters.get(name).is_some());
        let called = |parts: &[&str]| parts.iter().any(|part| name.contains(part));
        if called(&["ambient"]) {
            Self::Ambient
        } else if called(&["env", "sky", "dome", "occl", "indirect", "gather", "bleed"]) {
            Self::Sky
        } else if called(&["distant", "directional", "sun", "parallel", "farlight"]) {
            Self::Distant
        } else if called(&["spot"]) || has(&["coneangle", "cutoff", "cone_angle", "penumbraangle"]) {
            Self::Spot
        } else if has(&["to"]) && !has(&["from"]) {
            Self::Distant
        } else {
            Self::Point
        }
    }
}

/// The light of a shader, and what an unknown one is taken for.
///
/// # Model
/// RenderMan's surfaces reflect Kd times the light's colour, without 1 / pi, so the irradiance is pi times that colour.
/// An angle of more than pi can be no number of radians and is one of degrees.
///
/// # References
/// pixar2000 (appendix A.2)
pub(super) fn classic(
    name: &str,
    parameters: &Parameters,
    world_from_shader: Mat4,
) -> RibResult<(Source, Option<&'static str>)> {
    if matches!(name, "null" | "off") {
        return Ok((Source::Off, None));
    }
    let standard = Kind::standard(name);
    let kind = standard.unwrap_or_else(|| Kind::nearest(name, parameters));
    let color = emitted(parameters)?;
    let (from, to) = (parameters.triple("from", Vec3::ZERO), parameters.triple("to", Vec3::Z));
    let position = world_from_shader.transform_point3(from);
    let axis = || {
        let axis = world_from_shader.transform_point3(to) - position;
        axis.try_normalize().ok_or_else(|| format!("from {from} and to {to} are the same point"))
    };
    let names = ["decay", "decayrate", "decayRate", "falloff", "Falloff", "Decay"];
    let decay = match parameters.any_number(&names) {
        Some(0.0) => Decay::None,
        None if name.to_lowercase().contains("nofalloff") => Decay::None,
        None if standard.is_none() => Decay::Unknown,
        _ => Decay::Square,
    };
    let shadows = is_asked_for(parameters);
    let light = match kind {
        Kind::Ambient => return Ok((Source::Ambient(color), standard.is_none().then_some(kind.name()))),
        Kind::Sky => {
            let picture = parameters.any_text(&["filename", "envmap", "texturename", "envname", "map"]);
            let picture = picture.filter(|name| !is_map_of_shadows(name)).map(str::to_owned);
            return Ok((Source::Sky(color, picture), Some(kind.name())));
        }
        Kind::Distant => DirectionalLight { direction: -axis()?, irradiance: PI * color, radius_degrees: 0.0 }.into(),
        Kind::Point => Light::Point(PointLight { position, intensity: PI * color }),
        Kind::Spot => {
            let cone = parameters.any_number(&["coneangle", "cone_angle", "cutoff", "penumbraangle"]);
            let edge = parameters.any_number(&["conedeltaangle", "penumbra", "conedelta"]);
            let in_degrees = cone.is_some_and(|angle| angle > PI) || edge.is_some_and(|angle| angle > PI);
            let degrees = |angle: Option<f32>, default: f32| match angle {
                Some(angle) if in_degrees => angle,
                Some(angle) => angle.to_degrees(),
                None => default,
            };
            Light::Spot(SpotLight {
                position,
                axis: axis()?,
                intensity: PI * color,
                angle_degrees: checked("coneangle", degrees(cone, 30.0))?,
                edge_degrees: checked("conedeltaangle", degrees(edge, 5.0))?,
                falloff: parameters.number("beamdistribution", 2.0).max(0.0),
            })
        }
    };
    let note = standard.is_none().then_some(kind.name());
    Ok((Source::Light { light, decay, shadows }, note))
}

fn checked(name: &str, degrees: f32) -> RibResult<f32> {
    if (0.0..=180.0).contains(&degrees) {
        Ok(degrees)
    } else {
        Err(format!("{name}: found {degrees} degrees, expected 0 to 180"))
    }
}

/// Whether a light's own parameters ask for shadows.
fn is_asked_for(parameters: &Parameters) -> bool {
    parameters.any_text(&["shadowname", "shadowmap", "shadowfile"]).is_some()
        || ["shadows", "raytraced", "raytrace", "useshadows"]
            .iter()
            .any(|name| parameters.text(name).is_some_and(|text| text == "on") || parameters.number(name, 0.0) > 0.0)
}

/// Whether a file holds occlusion or shadows, not light.
fn is_map_of_shadows(name: &str) -> bool {
    let name = name.to_lowercase();
    ["occl", "shadow", ".sm", ".ptc", ".bkm"].iter().any(|part| name.contains(part))
}

/// `intensity` times `lightcolor` of a light source shader, times two to the power of `exposure`.
pub(super) fn emitted(parameters: &Parameters) -> RibResult<Vec3> {
    let intensity = parameters.any_number(&["intensity", "Intensity", "Kl"]).unwrap_or(1.0);
    let named = ["lightcolor", "lightColor", "color", "lightColour", "rman__lightColor"];
    let tint = named.iter().map(|name| parameters.triple(name, Vec3::NAN)).find(|c| !c.is_nan());
    let color = intensity * parameters.number("exposure", 0.0).exp2() * tint.unwrap_or(Vec3::ONE);
    if !color.is_finite() || color.min_element() < 0.0 {
        return Err(format!("intensity times lightcolor: found {color}, expected finite values of at least 0"));
    }
    Ok(color)
}

/// A light of the newer interface; `None` for an unknown name. Its shapes have a diameter of 1 and shine along z.
pub(super) fn newer(name: &str, parameters: &Parameters, world_from_light: Mat4) -> RibResult<Option<Source>> {
    let color = emitted(parameters)?;
    let point = |p: Vec3| world_from_light.transform_point3(p);
    let vector = |v: Vec3| world_from_light.transform_vector3(v);
    let shadows = parameters.number("enableShadows", 1.0) != 0.0;
    // A light may be normalised: its radiance is then divided by its area.
    let normalized = parameters.number("areaNormalize", 0.0) > 0.0;
    let area = |shape: Emitter| {
        let area = if normalized { shape.area().max(f32::MIN_POSITIVE) } else { 1.0 };
        Source::Light { light: Light::Area(AreaLight::new(shape, color / area)), decay: Decay::Square, shadows: true }
    };
    let flat = || {
        let (x, y) = (vector(0.5 * Vec3::X), vector(0.5 * Vec3::Y));
        // the lit side is that of x cross y
        let [x, y] = if x.cross(y).dot(vector(Vec3::Z)) < 0.0 { [y, x] } else { [x, y] };
        let flat = Flat { centre: point(Vec3::ZERO), x, y };
        x.cross(y).length_squared().is_normal().then_some(flat).ok_or("the light has no area")
    };
    Ok(Some(match name {
        "PxrDomeLight" | "PxrStdEnvMapLight" => {
            let picture = parameters.any_text(&["lightColorMap", "rman__EnvMap", "textureName"]).map(str::to_owned);
            Source::Sky(color, picture)
        }
        "PxrEnvDayLight" | "PxrStdEnvDayLight" => Source::Sky(color * Vec3::new(0.75, 0.9, 1.2), None),
        "PxrDistantLight" => {
            let direction = -vector(Vec3::Z).try_normalize().ok_or("the transform is singular")?;
            let radius_degrees = 0.5 * parameters.number("angleExtent", 0.53).clamp(0.0, 90.0);
            let light = DirectionalLight { direction, irradiance: PI * color, radius_degrees }.into();
            Source::Light { light, decay: Decay::Square, shadows }
        }
        "PxrRectLight" | "PxrPortalLight" => area(Emitter::Rectangle(flat()?)),
        "PxrDiskLight" => area(Emitter::Disk(flat()?)),
        "PxrSphereLight" | "PxrCylinderLight" => {
            let radius = 0.5 * vector(Vec3::X).length();
            let shape = Emitter::Sphere { centre: point(Vec3::ZERO), radius };
            (radius > 0.0).then(|| area(shape)).ok_or("the light has no area")?
        }
        "PxrMeshLight" | "PxrStdAreaLight" => Source::Shapes(color),
        _ => return Ok(None),
    }))
}
