//! Materials as shaders: functions in a shading language, and numbers in array textures.
//!
//! A recipe is written once, in a small language ([`lang`]), and printed for each target ([`mod@print`]). Numbers go to three array textures
//! ([`bank`]): half precision for values, 8 bits for indices, single precision for the search of directions.

mod bank;
mod emit;
pub(super) mod folder;
mod lang;
mod models;
mod print;
mod rsl;
#[cfg(test)]
mod tests;

pub(super) use bank::{Bank, Format};
pub(super) use print::Language;

use std::path::Path;

use glam::{Vec2, Vec3};
use half::f16;
use serde::Serialize;

use super::tables::{check_directions, triangulated};
use super::{check_known, model_in};
use crate::codec::CompressedBtf;
use crate::codec::interpret::Interpreter;
use crate::direction::Scheme;
use crate::material::Blending;
use crate::material::angles::Angles;
use crate::random::Stream;
use crate::{Error, Result};
use emit::{Emitter, Places};
use lang::Program;

/// Points at which the loss is measured.
const POINTS: usize = 1000;

/// A material as a program with its textures.
pub(super) struct Shader {
    material: Program,
    lights: Program,
    scene: Program,
    pub banks: [Bank; 3],
    pub places: Places,
    /// Its numbers, without offsets and scales.
    pub numbers: Interpreter,
    pub loss: Loss,
}

/// The differences that half precision makes, of apparent values at random points and directions.
#[derive(Debug, Clone, Copy, Serialize)]
pub(super) struct Loss {
    pub points: usize,
    pub mean: f32,
    pub largest: f32,
    /// The largest value.
    pub values_up_to: f32,
}

/// Checks that a material can become a shader.
///
/// # Errors
/// [`Error::Unsupported`].
pub(super) fn check(path: &Path, material: &CompressedBtf) -> Result<()> {
    check_directions(path, material.meta())?;
    check_known(path, &material.parts().recipe().value)?;
    model_in(&material.parts().recipe().value).map_or(Ok(()), |model| models::check(path, model))
}

impl Shader {
    /// Writes the program and the textures of a material.
    ///
    /// # Errors
    /// Errors of reading the material; [`Error::Unsupported`] for numbers that are too many, or too large for half
    /// precision.
    pub fn new(path: &Path, material: &CompressedBtf) -> Result<Self> {
        Self::rounded(path, material, Format::Half)
    }

    /// As [`Self::new`], with numbers in single precision.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn single(path: &Path, material: &CompressedBtf) -> Result<Self> {
        Self::rounded(path, material, Format::Single)
    }

    fn rounded(path: &Path, material: &CompressedBtf, format: Format) -> Result<Self> {
        let meta = material.meta();
        let exact = Interpreter::new(&**material.parts())?;
        let round = |number: f64| if format == Format::Half { f16::from_f64(number).to_f32() } else { number as f32 };
        let rounded = exact.explicit(&round);
        let recipe = rounded.recipe();
        let planes = recipe.planes.iter().enumerate().map(|(k, spec)| (&spec.name, rounded.plane(k)));
        let tables = recipe.tables.iter().enumerate().map(|(k, spec)| (&spec.name, rounded.table(k)));
        if let Some((name, _)) = planes.chain(tables).find(|(_, all)| !all.iter().all(|number| number.is_finite())) {
            return Err(Error::unsupported(
                path,
                format!("{name} has numbers beyond 65504, the range of half precision"),
            ));
        }
        let [views, lights] = [("views", &meta.views), ("lights", &meta.lights)];
        let [views, lights] = [triangulated(path, views.0, views.1)?, triangulated(path, lights.0, lights.1)?];
        let (program, banks, places) = Emitter::new(path, meta, &rounded, format).program(&views, &lights)?;
        banks.iter().try_for_each(|bank| bank.check(path))?;
        let loss = loss(&exact, &rounded, &Angles::new(meta, Scheme::Triangles)?)?;
        Ok(Self {
            material: program,
            lights: Program::parse(include_str!("lights.glsl"))?,
            scene: Program::parse(include_str!("scene.glsl"))?,
            banks,
            places,
            numbers: rounded,
            loss,
        })
    }

    /// The functions of the material, between a head and a tail, which have placeholders for the sizes of textures.
    pub fn functions(&self, language: Language, head: &str, tail: &str) -> String {
        self.filled(format!("{head}\n{}{tail}", self.material.print(language)))
    }

    /// The same in the RenderMan Shading Language.
    pub fn rsl(&self, head: &str, tail: &str) -> String {
        self.filled(format!("{head}\n{}{tail}", rsl::print(&self.material)))
    }

    /// A text with the sizes of textures.
    fn filled(&self, text: String) -> String {
        self.banks.iter().fold(text, |text, bank| {
            let [width, height, layers] = bank.size();
            let [columns, lines] = bank.sides();
            let sides = [
                ("WIDTH", width),
                ("HEIGHT", height),
                ("ROWS", height * layers),
                ("COLUMNS", columns),
                ("LINES", lines),
            ];
            let put = |text: String, (side, size): (&str, usize)| {
                text.replace(&format!("{{{}_{side}}}", bank.name), &size.to_string())
            };
            sides.into_iter().fold(text, put)
        })
    }

    /// The functions of lights, after a head with those that they call.
    pub fn lights(&self, language: Language, head: &str) -> String {
        format!("{head}\n{}", self.lights.print(language))
    }

    /// The function of the test scene.
    pub fn scene(&self, language: Language) -> String {
        self.scene.print(language)
    }
}

impl Loss {
    /// A text with these numbers.
    pub fn filled(&self, text: &str) -> String {
        text.replace("{largest}", &format!("{:.1e}", self.largest))
            .replace("{mean}", &format!("{:.1e}", self.mean))
            .replace("{values}", &format!("{:.2}", self.values_up_to))
            .replace("{points}", &self.points.to_string())
    }
}

fn loss(exact: &Interpreter, rounded: &Interpreter, angles: &Angles) -> Result<Loss> {
    let (mut random, blending) = (Stream::new(1), exact.recipe().blending(Blending::Auto));
    let mut loss = Loss { points: POINTS, mean: 0.0, largest: 0.0, values_up_to: 0.0 };
    for _ in 0..POINTS {
        let mut direction = || {
            let (z, phi) = (random.range(0.02, 1.0), random.range(0.0, std::f32::consts::TAU));
            let radius = (1.0 - z * z).sqrt();
            Vec3::new(radius * phi.cos(), radius * phi.sin(), z)
        };
        let (wi, wo) = (direction(), direction());
        let uv = Vec2::new(random.next(), random.next());
        let [a, b] = [exact, rounded].map(|parts| parts.apparent(uv, angles, blending, wi, wo));
        let (a, b) = (a?, b?);
        loss.values_up_to = loss.values_up_to.max(a.max_element());
        loss.largest = loss.largest.max((a - b).abs().max_element());
        loss.mean += (a - b).abs().element_sum() / (3 * POINTS) as f32;
    }
    Ok(loss)
}
