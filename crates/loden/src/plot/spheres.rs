//! Rows of spheres under one light.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::NamedMaterial;
use crate::Result;
use crate::direction::Frame;
use crate::material::Material;
use crate::picture::{CELL, Picture};
use crate::progress::{Progress, Task};

/// Samples per pixel and axis.
const SAMPLES: usize = 4;

/// Direction to the light: upper left, in front.
const LIGHT: Vec3 = Vec3::new(-0.42, 0.55, 0.72);

/// Renders spheres of `size` pixels in rows of `columns`, by parallel projection. The light comes from the upper left;
/// weak fill lights brighten the shadow side. A white diffuse sphere has the value 1 where it faces the light. Tangents
/// follow the circles of latitude.
///
/// # Errors
/// [`crate::Error::Cancelled`]; as [`Material::check`].
pub fn spheres(materials: &[&dyn Material], size: usize, columns: usize, progress: &dyn Progress) -> Result<Picture> {
    let columns = columns.clamp(1, materials.len().max(1));
    let rows = materials.len().div_ceil(columns);
    let mut picture = Picture::filled(columns * size, rows * size, Vec3::splat(0.02));
    let task = Task::new(progress, "draw", picture.height as u64);
    picture.rgb.par_chunks_mut(columns * size).enumerate().try_for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            if let Some(material) = materials.get(y / size * columns + x / size) {
                *pixel = shade(*material, (x % size, y % size), size, *pixel);
            }
        }
        task.advance(1)
    })?;
    drop(task);
    materials.iter().try_for_each(|material| material.check())?;
    Ok(picture)
}

/// As [`spheres`], with the name of each material below its sphere.
///
/// # Errors
/// As [`spheres`].
pub fn named_spheres(
    materials: &[NamedMaterial],
    size: usize,
    columns: usize,
    progress: &dyn Progress,
) -> Result<Picture> {
    let bare: Vec<&dyn Material> = materials.iter().map(|(_, material)| *material).collect();
    let plain = spheres(&bare, size, columns, progress)?;
    let (columns, rows) = (plain.width / size, plain.height / size);
    let scale = (size / 150).max(1);
    let line = CELL[1] * scale + 2;
    let mut picture = Picture::filled(plain.width, rows * (size + line), Vec3::splat(0.02));
    for (y, row) in plain.rgb.chunks_exact(plain.width).enumerate() {
        let to = (y / size * (size + line) + y % size) * plain.width;
        picture.rgb[to..][..plain.width].copy_from_slice(row);
    }
    for (k, (name, _)) in materials.iter().enumerate() {
        let place = [k % columns * size, k / columns * (size + line) + size];
        picture.write_centred(place, size, name, Vec3::splat(0.6), scale);
    }
    Ok(picture)
}

fn shade(material: &dyn Material, (x, y): (usize, usize), size: usize, background: Vec3) -> Vec3 {
    let mut sum = Vec3::ZERO;
    for k in 0..SAMPLES * SAMPLES {
        let offset = Vec2::new((k % SAMPLES) as f32 + 0.5, (k / SAMPLES) as f32 + 0.5) / SAMPLES as f32;
        let at = (Vec2::new(x as f32, y as f32) + offset) / size as f32 * 2.0 - 1.0;
        let at = Vec2::new(at.x, -at.y) / 0.92;
        sum += match 1.0 - at.length_squared() {
            z2 if z2 > 0.0 => surface(material, at.extend(z2.sqrt())),
            _ => background,
        };
    }
    sum / (SAMPLES * SAMPLES) as f32
}

/// Fill lights: (direction, fraction of the main light).
const FILL: [(Vec3, f32); 3] =
    [(Vec3::new(0.8, 0.1, 0.59), 0.06), (Vec3::new(-0.1, -0.75, 0.65), 0.04), (Vec3::new(0.1, 0.8, 0.59), 0.05)];

fn surface(material: &dyn Material, normal: Vec3) -> Vec3 {
    let frame = Frame::from_normal_tangent(normal, Vec3::Y.cross(normal));
    let wo = frame.local(Vec3::Z);
    let light = |direction: Vec3| material.apparent(Vec2::ZERO, frame.local(direction.normalize()), wo);
    let fill: Vec3 = FILL.iter().map(|(direction, share)| light(*direction) * *share).sum();
    light(LIGHT) + fill
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Lambert;
    use crate::progress::Silent;

    #[test]
    fn a_white_sphere_reads_one_towards_the_light() {
        let white = Lambert { albedo: Vec3::ONE };
        let black = Lambert { albedo: Vec3::ZERO };
        let picture = spheres(&[&white, &black, &white], 64, 2, &Silent).unwrap();
        assert_eq!((picture.width, picture.height), (128, 128));
        let brightest = picture.rgb.iter().map(|c| c.y).fold(0.0, f32::max);
        assert!((1.0..1.15).contains(&brightest), "{brightest}");
        assert_eq!(picture.at(64 + 32, 32), Vec3::ZERO);
        // The light is on the upper left, and the last place is empty.
        assert!(picture.at(20, 16).y > 2.0 * picture.at(44, 48).y);
        assert_eq!(picture.at(100, 100), Vec3::splat(0.02));
        // names stand below, and the spheres are the same
        let named = named_spheres(&[("a", &white), ("b", &black), ("c", &white)], 64, 2, &Silent).unwrap();
        assert_eq!((named.width, named.height), (128, 2 * (64 + 11)));
        assert!((0..64).all(|y| (0..128).all(|x| named.at(x, y) == picture.at(x, y))));
        assert!((0..64).any(|x| (65..75).any(|y| named.at(x, y).x > 0.5)));
    }
}
