//! Surfaces of RenderMan's newer interface: `Bxdf` and the `Pattern`s it refers to.

use std::collections::HashMap;
use std::sync::Arc;

use glam::Vec3;

use super::request::Parameters;
use super::shaded::{Base, Look};
use super::surface::{Translated, picture_of};

/// The patterns defined so far, by handle.
pub(super) type Patterns = Arc<HashMap<String, Parameters>>;

/// The names of the colour of a surface, in the order in which they are used.
const COLORS: &[&str] = &[
    "baseColor",
    "diffuseColor",
    "frontColor",
    "diffuseReflectionColor",
    "color",
    "diffuse",
    "albedo",
    "emitColor",
    "specularFaceColor",
    "specularColor",
    "transmissionColor",
    "refractionColor",
    "reflectionColor",
];

/// The look of a Bxdf. `known` is false if nothing of it is understood.
pub(super) fn translate(name: &str, parameters: &Parameters, patterns: &Patterns, color: Vec3) -> Translated {
    let mut texture = None;
    let found = COLORS.iter().find_map(|name| color_of(parameters, name, patterns, &mut texture, 0));
    let known = name.starts_with("Pxr") || name.starts_with("PXR") || name.starts_with("Lama") || found.is_some();
    let color = match (&found, &texture) {
        (_, Some(_)) => Vec3::ONE,
        (Some(found), _) => *found,
        (None, _) => color,
    };
    let mut unused = None;
    let mut value = |name: &str| color_of(parameters, name, patterns, &mut unused, 0);
    let gain = parameters.number("diffuseGain", 1.0).max(0.0);
    let specular =
        value("specularFaceColor").unwrap_or(Vec3::ZERO).max(0.3 * value("specularEdgeColor").unwrap_or_default());
    let roughness = parameters.any_number(&["roughness", "specularRoughness"]).unwrap_or(0.3).clamp(0.0, 1.0);
    let metallic = parameters.number("metallic", 0.0).clamp(0.0, 1.0);
    let level = parameters.number("specular", 0.5).max(0.0) * 0.08;
    // roughness^2 is the width of the slopes; RenderMan's specular() has the exponent 2 / roughness^4
    let lobe = |roughness: f32| 0.5 * roughness.max(0.02).powi(4);
    let base = match name {
        "PxrBlack" => Base::Matte { diffuse: Vec3::ZERO },
        "PxrConstant" => {
            return Translated { look: Look::constant(color), texture, known };
        }
        "PxrDisney" | "PXRDisney" | "PxrDisneyBsdf" if metallic > 0.5 => {
            Base::Mirror { specular: color, roughness: lobe(roughness) }
        }
        "PxrDisney" | "PXRDisney" | "PxrDisneyBsdf" => {
            // The highlight of a height as RenderMan's specular(), from one of unit energy
            let height = level * (2.0 / lobe(roughness).max(1e-4)).min(200.0) / 8.0;
            let specular = Vec3::splat(height.min(1.0));
            Base::Plastic { diffuse: (1.0 - metallic) * color, specular, roughness: lobe(roughness) }
        }
        "PxrSurface" if gain * color.max_element() <= 0.02 && specular != Vec3::ZERO => {
            Base::Mirror { specular, roughness: lobe(roughness) }
        }
        "PxrSurface" | "PxrDiffuse" => Base::Matte { diffuse: gain * color },
        name if ["Metal", "Conductor"].iter().any(|part| name.contains(part)) => {
            Base::Mirror { specular: color, roughness: lobe(roughness) }
        }
        _ => Base::Matte { diffuse: color },
    };
    let emission = if parameters.number("glowGain", 0.0) > 0.0 {
        parameters.number("glowGain", 0.0) * value("glowColor").unwrap_or(Vec3::ONE)
    } else {
        value("emitColor").filter(|_| name != "PxrConstant").unwrap_or(Vec3::ZERO)
    };
    Translated {
        look: Look { emitted: emission.max(Vec3::ZERO), ambient: color, color, ..Look::of(base) },
        texture,
        known,
    }
}

/// The most patterns that a colour is followed through.
const MAX_PATTERNS: usize = 16;

/// The value of a colour parameter; of a reference, that of the pattern. Notes the picture of a texture pattern.
fn color_of(
    parameters: &Parameters,
    name: &str,
    patterns: &Patterns,
    texture: &mut Option<String>,
    depth: usize,
) -> Option<Vec3> {
    let p = parameters.get(name)?;
    if let Some(target) = p.texts.first() {
        let pattern = patterns.get(target.split(':').next().unwrap_or_default())?;
        return (depth < MAX_PATTERNS).then(|| pattern_color(pattern, patterns, texture, depth + 1)).flatten();
    }
    match p.numbers[..] {
        [value] => Some(Vec3::splat(value)),
        [r, g, b, ..] => Some(Vec3::new(r, g, b)),
        _ => None,
    }
}

/// The picture or the colour of a pattern: its own first colour, or that of the first pattern it refers to.
fn pattern_color(
    pattern: &Parameters,
    patterns: &Patterns,
    texture: &mut Option<String>,
    depth: usize,
) -> Option<Vec3> {
    if let Some(file) = picture_of(pattern) {
        texture.get_or_insert(file);
        return Some(Vec3::ONE);
    }
    let is_color = |name: &str| {
        let name = name.to_lowercase();
        ["color", "colour", "rgb", "cin", "input", "cs"].iter().any(|part| name.contains(part))
    };
    let candidates = pattern.0.iter().filter(|p| is_color(&p.name) || (p.is_declared("color") && p.numbers.len() == 3));
    candidates.map(|p| p.name.as_str()).find_map(|name| color_of(pattern, name, patterns, texture, depth))
}
