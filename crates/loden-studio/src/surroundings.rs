//! Pictures of surroundings as the browser draws them: a backdrop, and a few distant lights that stand for all of it.
//!
//! # Model
//! The picture is halved until there are enough parts: each time the part whose longer side times its light is the largest, where the
//! light of both halves is the same (median cut). A light for each part has the irradiance of the part, from the centroid of its light.
//!
//! # Limits
//! A sharp highlight shows the few lights as spots. The path tracer uses the picture itself.

use std::f32::consts::{PI, TAU};
use std::path::PathBuf;
use std::sync::Arc;

use axum::Json;
use axum::extract::{Query, State};
use axum::response::Response;
use glam::Vec3;
use loden::Error;
use loden::color::luminance;
use loden::picture::Picture;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::Studio;
use crate::extras::{PANORAMAS, has};
use crate::failure::{Answer, Failure, blocking};
use crate::images::{encoded, png_of};

/// Pixels of the picture that is cut, and of the backdrop.
const CUT: [usize; 2] = [256, 128];
const BACKDROP: [usize; 2] = [2048, 1024];

/// Pixels of a picture that is read.
const LARGEST: usize = 1 << 26;

/// Lights, at most.
const MOST: usize = 64;

#[derive(Deserialize)]
pub(crate) struct Surrounding {
    e: String,
    #[serde(default)]
    count: usize,
}

impl Studio {
    /// The file of a picture of surroundings.
    pub fn panorama(&self, id: &str) -> Answer<PathBuf> {
        let path = self.folders.find(id)?;
        if !has(&path, &PANORAMAS) {
            return Err(Failure::missing(&format!("picture of surroundings {id:?}")));
        }
        match Picture::dimensions(&path)? {
            (width, height) if width == 2 * height && width * height <= LARGEST => Ok(path),
            (width, height) => {
                let problem = format!(
                    "found {width} x {height} pixels, expected twice as many columns as rows, {LARGEST} in all at most"
                );
                Err(Error::invalid(&path, "size", problem).into())
            }
        }
    }
}

/// The picture as a backdrop.
pub(crate) async fn backdrop(State(studio): State<Arc<Studio>>, Query(one): Query<Surrounding>) -> Answer<Response> {
    blocking(move || {
        let picture = Picture::read_light(studio.panorama(&one.e)?, &mut Vec::new())?;
        Ok(png_of(encoded(&smaller(&picture, BACKDROP))?))
    })
    .await
}

/// Lights: a direction, y up, and the irradiance on a surface that faces it; the strongest first.
pub(crate) async fn lights(State(studio): State<Arc<Studio>>, Query(one): Query<Surrounding>) -> Answer<Json<Value>> {
    blocking(move || {
        let picture = Picture::read_light(studio.panorama(&one.e)?, &mut Vec::new())?;
        let cut = cut(&smaller(&picture, CUT), one.count.clamp(1, MOST));
        let lights = cut.iter().map(
            |(direction, irradiance)| json!({ "direction": direction.to_array(), "irradiance": irradiance.to_array() }),
        );
        Ok(Json(lights.collect()))
    })
    .await
}

/// Means of pixels, so that a picture has at most this size.
fn smaller(picture: &Picture, [width, height]: [usize; 2]) -> Picture {
    let (w, h) = (width.min(picture.width), height.min(picture.height));
    let range = |k: usize, of: usize, from: usize| k * from / of..((k + 1) * from / of).max(k * from / of + 1);
    let pixel = |i: usize| {
        let (columns, rows) = (range(i % w, w, picture.width), range(i / w, h, picture.height));
        let count = columns.len() * rows.len();
        let sum: Vec3 = rows.flat_map(|y| columns.clone().map(move |x| (x, y))).map(|(x, y)| picture.at(x, y)).sum();
        sum.max(Vec3::ZERO) / count as f32
    };
    Picture { width: w, height: h, rgb: (0..w * h).map(pixel).collect() }
}

/// The direction of a place of a picture in pixels: the middle column is -z, the top row +y.
fn direction(x: f32, y: f32, picture: &Picture) -> Vec3 {
    let (theta, phi) = (PI * y / picture.height as f32, TAU * (x / picture.width as f32 - 0.5));
    Vec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos())
}

/// A rectangle of pixels: left, top, width, height.
type Part = [usize; 4];

/// The irradiance of each pixel's light on a surface that faces it.
fn irradiances(picture: &Picture) -> Picture {
    let (w, h) = (picture.width, picture.height);
    let solid_angle = |y: usize| (PI * (y as f32 + 0.5) / h as f32).sin() * (PI / h as f32) * (TAU / w as f32);
    let rgb = picture.rgb.iter().enumerate().map(|(i, radiance)| *radiance * solid_angle(i / w)).collect();
    Picture { width: w, height: h, rgb }
}

fn pixels([left, top, width, height]: Part) -> impl Iterator<Item = (usize, usize)> {
    (top..top + height).flat_map(move |y| (left..left + width).map(move |x| (x, y)))
}

fn light_of(lit: &Picture, part: Part) -> f32 {
    pixels(part).map(|(x, y)| luminance(lit.at(x, y).to_array())).sum()
}

/// Lights in the place of a picture, the strongest first.
fn cut(picture: &Picture, count: usize) -> Vec<(Vec3, Vec3)> {
    let lit = irradiances(picture);
    let size = |part: Part| (part[2].max(part[3]) - 1) as f32 * light_of(&lit, part).sqrt();
    let whole = [0, 0, picture.width, picture.height];
    let mut parts = vec![(size(whole), whole)];
    while parts.len() < count {
        let Some(at) = (0..parts.len()).max_by(|a, b| parts[*a].0.total_cmp(&parts[*b].0)) else { break };
        let (largest, part) = parts[at];
        if largest <= 0.0 {
            break;
        }
        let [first, second] = halved(&lit, part);
        parts[at] = (size(first), first);
        parts.push((size(second), second));
    }
    let mut lights: Vec<(Vec3, Vec3)> = parts.into_iter().map(|(_, part)| light(&lit, part)).collect();
    let strength = |light: &(Vec3, Vec3)| luminance(light.1.to_array());
    lights.retain(|light| strength(light) > 0.0);
    lights.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
    lights
}

/// Two parts with about the same light, cut across the longer side as it is seen.
fn halved(lit: &Picture, [left, top, width, height]: Part) -> [Part; 2] {
    let middle = PI * (top as f32 + 0.5 * height as f32) / lit.height as f32;
    let wide = height < 2 || width > 1 && width as f32 * middle.sin() >= height as f32;
    let strip = |k: usize| match wide {
        true => [left + k, top, 1, height],
        false => [left, top + k, width, 1],
    };
    let half = 0.5 * light_of(lit, [left, top, width, height]);
    let last = if wide { width } else { height } - 1;
    let (mut k, mut sum) = (0, 0.0);
    while k < last && (k == 0 || sum < half) {
        sum += light_of(lit, strip(k));
        k += 1;
    }
    match wide {
        true => [[left, top, k, height], [left + k, top, width - k, height]],
        false => [[left, top, width, k], [left, top + k, width, height - k]],
    }
}

fn light(lit: &Picture, part: Part) -> (Vec3, Vec3) {
    let (mut sum, mut place) = (Vec3::ZERO, Vec3::ZERO);
    for (x, y) in pixels(part) {
        let irradiance = lit.at(x, y);
        sum += irradiance;
        place += luminance(irradiance.to_array()) * direction(x as f32 + 0.5, y as f32 + 0.5, lit);
    }
    (place.try_normalize().unwrap_or(Vec3::Y), sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lights_have_all_the_light_and_are_where_it_is() {
        let mut picture = Picture::filled(64, 32, Vec3::splat(0.5));
        let total = |lights: &[(Vec3, Vec3)]| lights.iter().map(|light| light.1).sum::<Vec3>();
        for count in [1, 7, 16] {
            let lights = cut(&picture, count);
            assert_eq!(lights.len(), count);
            // 4 pi of constant radiance
            assert!((total(&lights) / (0.5 * 4.0 * PI) - 1.0).abs().max_element() < 1e-3, "{lights:?}");
            let scattered = lights.iter().map(|light| light.0 * light.1.x).sum::<Vec3>().length();
            assert!(count == 1 || scattered < 0.1 * total(&lights).x, "{lights:?}");
        }
        // a sun in the middle column is at -z, a quarter of a turn to the right of it at +x
        for (column, expected) in [(32, Vec3::NEG_Z), (48, Vec3::X)] {
            picture.rgb.fill(Vec3::splat(1e-4));
            picture.rgb[16 * 64 + column] = Vec3::splat(1000.0);
            let lights = cut(&picture, 8);
            assert!(lights[0].0.dot(expected) > 0.99, "{column}: {:?}", lights[0]);
        }
        assert!(cut(&Picture::filled(8, 4, Vec3::ZERO), 4).is_empty());
    }

    #[test]
    fn smaller_pictures_have_the_same_mean() {
        let rgb = (0..18 * 9).map(|i| Vec3::splat((i * 7 % 11) as f32)).collect();
        let picture = Picture { width: 18, height: 9, rgb };
        let mean = |picture: &Picture| picture.rgb.iter().sum::<Vec3>().x / picture.rgb.len() as f32;
        let small = smaller(&picture, [6, 3]);
        assert!((small.width, small.height) == (6, 3) && (mean(&small) - mean(&picture)).abs() < 1e-4);
        assert_eq!(smaller(&picture, [99, 99]).rgb, picture.rgb);
    }
}
