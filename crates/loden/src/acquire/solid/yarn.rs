//! Woven cloth of plied yarns, built as geometry.

mod strand;
mod weave;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use self::strand::{FIBRE_STEPS, Ply, Tube};
use self::weave::Weave;
use super::{Paint, Solid};
use crate::random::{Stream, hash};
use crate::{Error, Result};

crate::params! {
    /// The parameters of a woven cloth.
    pub struct Options {
        /// Interlacing of warp and weft: plain, twill (over two, under two), basket (plain, of pairs) or satin (over seven, under one).
        pub weave: Weave = "twill",
        /// Yarns per side of the tile: a multiple of 2 for plain weave, 4 for twill and basket, 8 for satin.
        pub yarns: i32 [2..=48] = 8,
        /// Plies of a yarn.
        pub plies: i32 [1..=6] = 3,
        /// Turns of the plies around their yarn, per spacing of the yarns; rounded to whole turns per tile. Negative turns are left-handed.
        pub twist: f32 [-2.0..=2.0, "turns"] = 0.4,
        /// Angle between the fibres and the axis of their ply; the opposite sense of the twist lays them along the yarn.
        pub fibre_angle: f32 [-60.0..=60.0, "degrees"] = "-20",
        /// Width of a yarn relative to the spacing.
        pub width: f32 [0.2..=1.4] = 1.08,
        /// Thickness of a yarn relative to its width.
        pub flatness: f32 [0.2..=1.0] = 0.55,
        /// Albedo of the warp, which runs upwards.
        pub warp: [f64; 3] [0.0..=1.0] = "0.05,0.09,0.22",
        /// Albedo of the weft, which runs to the right.
        pub weft: [f64; 3] [0.0..=1.0] = "0.62,0.58,0.5",
        /// Specular reflectance of the fibres at normal incidence.
        pub specular: f32 [0.0..=1.0] = 0.045,
        /// GGX alpha along the fibres.
        pub roughness_along: f32 [0.02..=1.0] = 0.25,
        /// GGX alpha across the fibres.
        pub roughness_across: f32 [0.02..=1.0] = 0.6,
        /// Loose fibres that stand off the cloth, per crossing.
        pub fuzz: f32 [0.0..=50.0] = 3,
        /// Points around a ply; the time to prepare grows with the square.
        pub points: i32 [6..=96] = 36,
    }
}

/// Height of the axis of an upper yarn, relative to half its thickness: yarns press into each other.
const LIFT: f32 = 0.8;

/// Builds a cloth.
///
/// # Model
/// Warp yarns run along y, weft yarns along x. The axis of a yarn swings between an upper and a lower level by half cosines, so
/// that the upper yarn of a crossing rests on the lower one, into which it is pressed a little. Its plies are helices around the axis, flattened vertically,
/// and touch each other. Their surfaces have ridges along the fibres, which wind around the ply at a constant angle;
/// the coat is rough across the fibres and smoother along them, so highlights stretch across. Shade and thickness vary from
/// yarn to yarn and along it.
///
/// # Limits
/// Yarns are not pressed out of shape by their neighbours: wide ones pass through each other a little beside crossings.
/// Fibres do not transmit light.
///
/// # References
/// peirce1937 (the axes of woven yarns)
///
/// # Errors
/// [`Error::Parameter`] for a number of yarns that does not suit the weave.
pub fn build(options: &Options, seed: u64) -> Result<Solid> {
    let count = options.yarns;
    if count % options.weave.repeat() != 0 {
        let problem = format!("found {count}, expected a multiple of {}", options.weave.repeat());
        return Err(Error::parameter("yarns", problem));
    }
    let yarns: Vec<(bool, i32)> = (0..2 * count).map(|k| (k < count, k % count)).collect();
    let tubes: Vec<Vec<Tube>> = yarns.par_iter().map(|&(warp, k)| yarn(options, warp, k, seed)).collect();
    let rough = [options.roughness_along, options.roughness_across];
    let mut solid =
        Solid { paints: vec![Paint::plain(Vec3::ONE, options.specular, rough)], periodic: true, ..Solid::default() };
    tubes.into_iter().flatten().for_each(|tube| tube.append_to(&mut solid));
    solid.check()?;
    Ok(solid)
}

/// The plies of a yarn and the loose fibres on them.
fn yarn(options: &Options, warp: bool, k: i32, seed: u64) -> Vec<Tube> {
    let mut random = Stream::new(hash(&[seed, u64::from(warp), k as u64]));
    let count = options.yarns as f32;
    let radius = 0.5 * options.width * random.range(0.96, 1.02);
    let levels = (0..options.yarns).map(|j| options.weave.level(warp, k, j)).collect();
    let colour = if warp { options.warp } else { options.weft };
    let colour = Vec3::from(colour.map(|v| v as f32)) * random.range(0.9, 1.08);
    let phase = random.next();
    let ply_radius = radius / (1.0 + helix(options.plies));
    let turns = options.fibre_angle.to_radians().tan() * count / (std::f32::consts::TAU * ply_radius);
    let plies: Vec<Ply> = (0..options.plies)
        .map(|p| Ply {
            warp,
            place: k as f32 + 0.5 + random.range(-0.02, 0.02),
            count: options.yarns,
            levels: &levels,
            lift: LIFT * radius * options.flatness,
            helix: ply_radius * helix(options.plies),
            radius: ply_radius,
            flatness: options.flatness,
            phase: phase + p as f32 / options.plies as f32,
            turns: (options.twist * count).round(),
            fibre_turns: (turns * FIBRE_STEPS).round() / FIBRE_STEPS,
            colour: (colour * random.range(0.94, 1.06)).clamp(Vec3::ZERO, Vec3::splat(0.95)),
            seed: hash(&[seed, 7, u64::from(warp), k as u64, p as u64]),
        })
        .collect();
    let mut tubes: Vec<Tube> = plies.iter().map(|ply| ply.tube(options.points as usize)).collect();
    // every crossing has fibres of both yarns
    let loose = 0.5 * options.fuzz * count;
    let loose = loose as usize + usize::from(random.next() < loose.fract());
    tubes.extend((0..loose).map(|_| {
        let ply = &plies[(random.next() * plies.len() as f32) as usize % plies.len()];
        ply.loose_fibre(&mut random)
    }));
    tubes
}

/// The radius of the helices of touching plies, relative to that of a ply.
fn helix(plies: i32) -> f32 {
    if plies == 1 { 0.0 } else { 1.0 / (std::f32::consts::PI / plies as f32).sin() }
}

/// The direction of a position along a yarn, and across it, in the plane of the cloth.
fn axes(warp: bool) -> [Vec2; 2] {
    if warp { [Vec2::Y, Vec2::X] } else { [Vec2::X, Vec2::Y] }
}
