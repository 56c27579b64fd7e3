//! What targets share that show the closest standard material: its fit, and its maps as PNG files.

use std::io::Cursor;
use std::path::Path;

use image::{ExtendedColorType, ImageFormat};

use crate::Result;
use crate::codec::CompressedBtf;
use crate::color::Encoding;
use crate::direction::Scheme;
use crate::error::Error;
use crate::progress::Progress;
use crate::standard::{Standard, Texel, closest};

/// The standard material that is closest to a compressed one.
///
/// # Errors
/// As [`closest`].
pub(super) fn fitted(material: &CompressedBtf, progress: &dyn Progress) -> Result<Standard> {
    closest(&*material.material(Scheme::Triangles)?, material.meta(), progress)
}

/// The names of what is beside base colour, metal, roughness and normal, with what all texels have in common.
pub(super) fn described(standard: &Standard) -> String {
    let layers = standard.layers();
    let mut words = vec![format!("specular level (refractive index {:.2})", layers.ior())];
    words.extend(layers.grain.then(|| "anisotropy".into()));
    words.extend(layers.sheen.map(|roughness| format!("sheen (roughness {roughness:.3})")));
    words.extend(layers.coat.map(|roughness| format!("clear coat (roughness {roughness:.3})")));
    words.join(", ")
}

/// An 8-bit PNG file of what `of` gives for each texel, 0 to 1, as numbers of `N` channels: 1, 3 or 4. It says nothing about
/// the colour space, which every target defines by the use of the file.
///
/// # Errors
/// [`Error::Limit`] if the picture is too large for the format.
pub(super) fn png<const N: usize>(
    path: &Path,
    standard: &Standard,
    of: impl Fn(&Texel) -> [f32; N],
) -> Result<Vec<u8>> {
    let color = match N {
        1 => ExtendedColorType::L8,
        3 => ExtendedColorType::Rgb8,
        _ => ExtendedColorType::Rgba8,
    };
    let byte = |value: f32| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    let bytes: Vec<u8> = standard.rows().iter().flat_map(|texel| of(texel).map(byte)).collect();
    let ([width, height], mut file) = (standard.size().map(|side| side as u32), Cursor::new(Vec::new()));
    image::write_buffer_with_format(&mut file, &bytes, width, height, color, ImageFormat::Png)
        .map_err(|e| Error::invalid(path, "picture", e.to_string()))?;
    Ok(file.into_inner())
}

/// A colour as sRGB textures hold it.
pub(super) fn srgb(rgb: [f32; 3]) -> [f32; 3] {
    rgb.map(|value| Encoding::Srgb.encode(value))
}

/// The normal as textures hold it: 0 to 1, green upwards.
pub(super) fn normal(texel: &Texel) -> [f32; 3] {
    texel.normal.map(|value| 0.5 * value + 0.5)
}
