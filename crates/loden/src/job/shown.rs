//! Images of a BTF as pictures for display.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::Result;
use crate::btf::BtfMeta;
use crate::color::Encoding;
use crate::direction::from_angles;
use crate::material::Material;
use crate::picture::{CELL, Picture};

/// Pairs of directions that show most of a material: (light, view), polar angle and azimuth in degrees.
pub const SHOWN: [([f32; 2], [f32; 2]); 4] = [
    ([15.0, 60.0], [0.0, 0.0]),
    ([45.0, 180.0], [30.0, 0.0]),
    ([60.0, 90.0], [60.0, 0.0]),
    ([75.0, 210.0], [45.0, 300.0]),
];

/// Amplification of errors in [`error_picture`].
pub const ERROR_GAIN: f32 = 8.0;

/// The measured pairs (view, light) nearest to [`SHOWN`].
pub fn shown_pairs(meta: &BtfMeta) -> Vec<(usize, usize)> {
    let direction = |[theta, phi]: [f32; 2]| from_angles(theta.to_radians(), phi.to_radians());
    SHOWN.iter().map(|&(l, v)| meta.nearest_pair(direction(l), direction(v))).collect()
}

/// The picture that displays the stored values of one image.
pub fn stored_picture(meta: &BtfMeta, stored: &[f32]) -> Picture {
    let decode = |value: f32| match meta.encoding {
        Encoding::Linear => value,
        encoding => encoding.decode(value.clamp(0.0, 1.0)),
    };
    let rgb = stored.as_chunks::<3>().0.iter().map(|rgb| Vec3::from_array(rgb.map(decode))).collect();
    Picture { width: meta.width, height: meta.height, rgb }
}

/// The absolute differences of the stored values of two images, times [`ERROR_GAIN`].
pub fn error_picture(meta: &BtfMeta, original: &[f32], decoded: &[f32]) -> Picture {
    let error = |(a, b): (&f32, &f32)| (a - b.clamp(0.0, 1.0)).abs() * ERROR_GAIN;
    let errors: Vec<f32> = original.iter().zip(decoded).map(error).collect();
    stored_picture(meta, &errors)
}

/// Pictures under their names in rows of `columns`, on white. All are as large as the first one.
pub fn side_by_side(pictures: &[(String, Picture)], columns: usize) -> Picture {
    const GAP: usize = 4;
    let Some((_, first)) = pictures.first() else { return Picture::filled(1, 1, Vec3::ONE) };
    let (head, columns) = (CELL[1] + GAP, columns.clamp(1, pictures.len()));
    let cell = [first.width + GAP, first.height + head + GAP];
    let mut whole = Picture::filled(columns * cell[0], pictures.len().div_ceil(columns) * cell[1], Vec3::ONE);
    for (k, (name, picture)) in pictures.iter().enumerate() {
        let [left, top] = [k % columns * cell[0] + GAP / 2, k / columns * cell[1] + GAP / 2];
        whole.write_centred([left, top], first.width, name, Vec3::ZERO, 1);
        let (width, height) = (first.width.min(picture.width), first.height.min(picture.height));
        for y in 0..height {
            let start = (top + head + y) * whole.width + left;
            whole.rgb[start..start + width].copy_from_slice(&picture.rgb[y * picture.width..][..width]);
        }
    }
    whole
}

/// The sample photographed from `wo` under light from `wi`: apparent values at the centres of all texels.
///
/// # Errors
/// As [`Material::check`].
pub fn photograph(material: &dyn Material, width: usize, height: usize, wi: Vec3, wo: Vec3) -> Result<Picture> {
    let texel = |i: usize| {
        let (x, y) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
        material.apparent(Vec2::new(x / width as f32, 1.0 - y / height as f32), wi, wo)
    };
    let rgb = (0..width * height).into_par_iter().map(texel).collect();
    material.check()?;
    Ok(Picture { width, height, rgb })
}
