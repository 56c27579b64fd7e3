//! Surface shaders as looks: RenderMan's standard ones, and others by the names of their parameters.

use glam::Vec3;

use super::request::{Parameter, Parameters};
use super::shaded::{Base, Look};

/// A translated shader.
pub(super) struct Translated {
    pub look: Look,
    /// The picture that colours it, if it names one.
    pub texture: Option<String>,
    /// Whether it is a standard shader.
    pub known: bool,
}

/// The look of a surface shader and a colour.
///
/// # Model
/// A shader that is not RenderMan's own is taken for `plastic` if it has a highlight, for `matte` otherwise, with the
/// parameters that are called as in the standard shaders; without Kd and Ks, all of the colour is diffuse. A parameter
/// that is a colour, is called like one and is not black replaces `Color`; instead of black the colour is grey.
///
/// # References
/// pixar2000 (appendix A.1)
pub(super) fn translate(name: &str, parameters: &Parameters, color: Vec3) -> Translated {
    let number = |name: &str, default: f32| parameters.number(name, default).max(0.0);
    let roughness = parameters.any_number(&["roughness", "Roughness", "rough"]).unwrap_or(0.1).max(0.0);
    let specular_color = parameters.triple("specularcolor", Vec3::ONE);
    let ambient = number("Ka", 1.0);
    let plastic =
        |kd: f32, ks: f32, color: Vec3| Base::Plastic { diffuse: kd * color, specular: ks * specular_color, roughness };
    let mut texture = None;
    let mut known = true;
    let (base, color) = match name {
        "constant" | "null" => {
            return Translated { look: Look::constant(color), texture: None, known };
        }
        "matte" | "defaultsurface" => (Base::Matte { diffuse: number("Kd", 1.0) * color }, color),
        "metal" => {
            let specular = number("Ks", 1.0) * color;
            (Base::Plastic { diffuse: Vec3::ZERO, specular, roughness }, color)
        }
        "plastic" => (plastic(number("Kd", 0.5), number("Ks", 0.5), color), color),
        "paintedplastic" => {
            texture = parameters.text("texturename").filter(|name| !name.is_empty()).map(str::to_owned);
            (plastic(number("Kd", 0.5), number("Ks", 0.5), color), color)
        }
        "shinymetal" => (Base::Mirror { specular: number("Kr", 1.0) * color, roughness }, color),
        _ => {
            known = false;
            texture = picture_of(parameters);
            let color = color_of(parameters).unwrap_or(color);
            // A shader that ignores `Color` has colours of its own.
            let color = if color == Vec3::ZERO { Vec3::splat(0.5) } else { color };
            let kd = parameters.any_number(&["Kd", "kd", "diffuse", "Diffuse"]);
            let ks = parameters.any_number(&["Ks", "ks", "specular", "Specular"]).map(|ks| ks.max(0.0));
            let diffuse = kd.unwrap_or(1.0).max(0.0);
            match ks {
                Some(ks) if ks > 0.0 => (plastic(diffuse, ks, color), color),
                _ => (Base::Matte { diffuse: diffuse * color }, color),
            }
        }
    };
    Translated { look: Look { ambient: ambient * color, color, ..Look::of(base) }, texture, known }
}

/// The parameter that is most likely the colour of a surface.
fn color_of(parameters: &Parameters) -> Option<Vec3> {
    /// Beginnings of names, most likely first.
    const NAMES: &[&str] = &["basecolor", "basecolour", "diffusecolor", "surfacecolor", "color", "colour", "paint"];
    /// Parts of the names of other colours.
    const OTHERS: &[&str] = &["spec", "ambient", "opac", "trans", "light", "bg", "back", "reflect", "mortar", "shadow"];
    let is_color = |p: &&Parameter| {
        let name = p.name.to_lowercase();
        p.numbers.len() == 3
            && (p.is_declared("color") || name.contains("color") || name.contains("colour"))
            && !OTHERS.iter().any(|other| name.contains(other))
    };
    let colors: Vec<&Parameter> = parameters.0.iter().filter(is_color).collect();
    let colors = || colors.iter().filter(|p| p.numbers.iter().any(|&number| number > 0.0));
    let by_name = NAMES.iter().find_map(|name| colors().find(|p| p.name.to_lowercase().starts_with(name)));
    by_name.or(colors().next()).map(|p| Vec3::from_slice(&p.numbers).clamp(Vec3::ZERO, Vec3::ONE))
}

/// The file that is most likely a surface's colour.
pub(super) fn picture_of(parameters: &Parameters) -> Option<String> {
    const NAMES: &[&str] = &["tex", "map", "image", "file", "colormap"];
    const OTHERS: &[&str] = &["bump", "env", "refl", "spec", "shadow", "norm", "disp", "bake", "ptc", "opac"];
    const ENDINGS: &[&str] = &["tif", "tiff", "tx", "tex", "tdl", "png", "jpg", "jpeg", "exr", "hdr", "bmp", "rat"];
    let is_picture = |p: &&Parameter| {
        let name = p.name.to_lowercase();
        let file = p.texts.first().map(|text| text.to_lowercase()).unwrap_or_default();
        let ending = file.rsplit('.').next().filter(|ending| file.len() > ending.len()).unwrap_or_default();
        ENDINGS.contains(&ending)
            && NAMES.iter().any(|part| name.contains(part))
            && !OTHERS.iter().any(|other| name.contains(other) || file.contains(other))
    };
    parameters.0.iter().find(is_picture).and_then(|p| p.texts.first().cloned())
}
