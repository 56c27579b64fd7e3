//! Pictures of a sample that was turned on its stage.

use std::f64::consts::FRAC_PI_2;

use glam::{DVec2, Vec3};
use serde::Deserialize;

use super::pattern::Side;
use crate::Result;
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::picture::cubic;
use crate::picture::decode::Numbers;

crate::words! {
    /// The sense in which a sample turns in the pictures as the number in their names grows.
    #[derive(Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub(super) enum Sense {
        Ccw = "ccw",
        Cw = "cw",
    }
}

impl Sense {
    /// Degrees counter-clockwise.
    pub(super) fn degrees(self, number: f64) -> f64 {
        if self == Self::Ccw { number } else { -number }
    }
}

/// The directions of each file in the frame of its sample, which was turned by so many degrees counter-clockwise.
///
/// # Errors
/// As [`DirectionSet::from_degrees`].
pub(super) fn in_sample(side: &Side, turns: &[f64]) -> Result<Side> {
    let direction = |(&of_file, turn): (&usize, &f64)| {
        let [theta, phi] = side.set.degrees()[of_file];
        // rounding must not tell equal directions apart
        let phi = ((phi - turn) * 1e6).round() / 1e6;
        if theta == 0.0 { [0.0, 0.0] } else { [theta, phi.rem_euclid(360.0)] }
    };
    let of_files: Vec<[f64; 2]> = side.of_file.iter().zip(turns).map(direction).collect();
    let mut all = of_files.clone();
    all.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    all.dedup();
    let of_file = of_files.iter().map(|one| all.iter().position(|other| other == one).unwrap_or(0)).collect();
    Ok(Side { set: DirectionSet::from_degrees(all)?, of_file })
}

/// Width and height of what all pictures show, turned back: the whole for half turns, else the largest square about the
/// centre.
pub(super) fn common_size([width, height]: [usize; 2], turns: &[f64]) -> [usize; 2] {
    if turns.iter().all(|turn| turn.rem_euclid(180.0) == 0.0) {
        return [width, height];
    }
    let least = width.min(height);
    let side = turns.iter().map(|turn| {
        let (sin, cos) = sin_cos(*turn);
        (least as f64 / (sin.abs() + cos.abs()) + 1e-9) as usize
    });
    let side = side.min().unwrap_or(least);
    // with the parity of the width, upright pictures are copied without half a pixel's blur
    [side - usize::from(side > 1 && side % 2 != width % 2); 2]
}

/// A picture of `size` whose sample was turned by so many degrees counter-clockwise about its centre, turned back, and cut to the
/// size `to` about the centre: cubic interpolation (Catmull-Rom) of linear light.
pub(super) fn turned_back(
    numbers: Numbers,
    size: [usize; 2],
    degrees: f64,
    to: [usize; 2],
    encoding: Encoding,
) -> Numbers {
    if size == to && degrees.rem_euclid(360.0) == 0.0 {
        return numbers;
    }
    let whole = |v: f32| v.clamp(0.0, 1.0);
    match numbers {
        Numbers::U8(stored) => {
            let light: Vec<f32> = stored.iter().map(|v| encoding.decode(f32::from(*v) / 255.0)).collect();
            let turned = turn(&light, size, degrees, to).into_iter();
            Numbers::U8(turned.map(|v| (whole(encoding.encode(v)) * 255.0).round() as u8).collect())
        }
        Numbers::U16(stored) => {
            let light: Vec<f32> = stored.iter().map(|v| encoding.decode(f32::from(*v) / 65_535.0)).collect();
            let turned = turn(&light, size, degrees, to).into_iter();
            Numbers::U16(turned.map(|v| (whole(encoding.encode(v)) * 65_535.0).round() as u16).collect())
        }
        Numbers::F32(stored) => {
            let light: Vec<f32> = stored.iter().map(|v| encoding.decode(*v)).collect();
            Numbers::F32(turn(&light, size, degrees, to).into_iter().map(|v| encoding.encode(v)).collect())
        }
    }
}

/// Sine and cosine of degrees, exact for quarter turns.
fn sin_cos(degrees: f64) -> (f64, f64) {
    let quarters = degrees / 90.0;
    if quarters.fract() == 0.0 {
        let (sin, cos) = [(0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0)][quarters.rem_euclid(4.0) as usize];
        return (sin, cos);
    }
    (quarters * FRAC_PI_2).sin_cos()
}

fn turn(light: &[f32], size: [usize; 2], degrees: f64, to: [usize; 2]) -> Vec<f32> {
    let pixels: Vec<Vec3> = light.chunks_exact(3).map(Vec3::from_slice).collect();
    let (sin, cos) = sin_cos(degrees);
    let turn = DVec2::new(cos, sin);
    let [middle, to_middle] = [size, to].map(|[width, height]| DVec2::new(width as f64, height as f64) / 2.0);
    let pixel = |i: usize| {
        let (column, row) = (i % to[0], i / to[0]);
        // from the centre, y upwards
        let from = DVec2::new(column as f64 + 0.5 - to_middle.x, to_middle.y - row as f64 - 0.5);
        let place = turn.rotate(from);
        cubic::at(&pixels, size, middle + DVec2::new(place.x, -place.y)).max(Vec3::ZERO).to_array()
    };
    (0..to[0] * to[1]).flat_map(pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A smooth picture of a sample that was turned about the centre.
    fn picture([width, height]: [usize; 2], degrees: f64) -> Vec<u8> {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let pixel = |i: usize| {
            let (x, y) =
                ((i % width) as f64 + 0.5 - width as f64 / 2.0, height as f64 / 2.0 - (i / width) as f64 - 0.5);
            let (x, y) = (cos * x + sin * y, -sin * x + cos * y);
            let value = 0.5 + 0.2 * (0.35 * x).sin() + 0.15 * (0.25 * y + 0.1 * x).cos();
            [value, 0.8 * value, 0.3].map(|v| (v * 255.0).round() as u8)
        };
        (0..width * height).flat_map(pixel).collect()
    }

    #[test]
    fn turned_pictures_are_turned_back() {
        let (size, turns) = ([74, 54], [0.0, 5.0, 10.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0, 180.0, 270.0, -30.0]);
        let to = common_size(size, &turns);
        assert_eq!(to, [38, 38]);
        let upright = turned_back(Numbers::U8(picture(size, 0.0)), size, 0.0, to, Encoding::Srgb);
        let Numbers::U8(upright) = upright else { panic!("8 bits stay 8 bits") };
        let expected = picture([38, 38], 0.0);
        assert_eq!(upright, expected, "an upright picture is cut only");
        for degrees in turns {
            let Numbers::U8(found) =
                turned_back(Numbers::U8(picture(size, degrees)), size, degrees, to, Encoding::Srgb)
            else {
                panic!("8 bits stay 8 bits")
            };
            let worst = found.iter().zip(&expected).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(worst <= Some(2), "{degrees}: {worst:?}");
        }
    }

    #[test]
    fn directions_are_those_of_the_sample() {
        let set = DirectionSet::from_degrees(vec![[0.0, 0.0], [45.0, 20.0]]).unwrap();
        let side = Side { set, of_file: vec![0, 1, 1, 0, 1] };
        let turned = in_sample(&side, &[0.0, 0.0, 30.0, 30.0, 380.0]).unwrap();
        assert_eq!(turned.set.degrees(), [[0.0, 0.0], [45.0, 0.0], [45.0, 20.0], [45.0, 350.0]]);
        assert_eq!(turned.of_file, [0, 2, 3, 0, 1]);
    }
}
