//! Edits of chosen rows: colour, gloss, contrast, light.
//!
//! # Model
//! A row is separated into its diffuse part and its highlight ([`Separated`]), which change separately until the last step:
//!
//! 1. [`Edit::recolor`] changes the albedo: hue and chroma in CIE Lab (D65), at a luminance of 0.3, so that dark and bright
//!    rows of one colour stay of one colour. Highlights keep the colour of the light.
//! 2. [`Edit::contrast`] raises the ratio of the diffuse part to that of an even, matt plane of the same albedo to a power: 0
//!    removes shadows and shading, 2 deepens them.
//! 3. [`Edit::gloss`] divides the roughness of the highlight, [`Edit::highlights`] multiplies its strength. Measured highlights
//!    change as the fitted one about the normals that each view sees.
//! 4. [`Edit::desaturate`], [`Edit::tint`] and [`Edit::exposure`] apply to the sum, in linear light.
//!
//! An edit that changes nothing leaves a row as it is, bit for bit.
//!
//! # Limits
//! Those of [`super::reflectance`]. Light that other parts of the surface reflect keeps its old colour in part, since it is not known
//! how often it was reflected.
//!
//! # References
//! kautz2007, shafer1985

use std::collections::BTreeMap;
use std::str::FromStr;

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;

use super::facets::Facets;
use super::reflectance::{Geometry, Separated};
use super::{Rows, Selection};
use crate::codec::parts::MemoryParts;
use crate::color::{Encoding, luminance};
use crate::metric::lab;
use crate::{Error, Result};

/// The luminance at which hues are turned.
const LEVEL: f32 = 0.3;

/// Range of the roughness of changed highlights.
const ALPHA: [f32; 2] = [0.02, 1.0];

/// Bounds of the ratios that a contrast changes.
const RATIOS: [f32; 2] = [0.02, 50.0];

/// A change of colour.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Recolor {
    /// A change of hue, chroma and lightness in CIE Lab.
    Turn {
        /// Degrees that hues are turned by, from red to yellow to green.
        hue: f32,
        /// Factor of the chroma.
        saturation: f32,
        /// Added to the lightness L* of a surface of luminance 0.3.
        lightness: f32,
    },
    /// Multiplies by the ratio of two linear colours, so that the first becomes the second.
    Ratio {
        /// The colour that is replaced.
        from: [f32; 3],
        /// The colour that replaces it.
        to: [f32; 3],
    },
}

/// Changes of a row. The default changes nothing.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Edit {
    /// Colour of the diffuse part.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recolor: Option<Recolor>,
    /// Divides the roughness of highlights.
    pub gloss: f32,
    /// Factor of the strength of highlights.
    pub highlights: f32,
    /// Exponent of shadows and shading.
    pub contrast: f32,
    /// Colour of a filter in front of the light, linear.
    pub tint: [f32; 3],
    /// Brightness in stops.
    pub exposure: f32,
    /// How far colours move to grey of the same luminance, 0 to 1.
    pub desaturate: f32,
}

impl Default for Edit {
    fn default() -> Self {
        let (gloss, highlights, contrast) = (1.0, 1.0, 1.0);
        Self { recolor: None, gloss, highlights, contrast, tint: [1.0; 3], exposure: 0.0, desaturate: 0.0 }
    }
}

impl Recolor {
    /// Whether no colour changes.
    pub fn is_neutral(self) -> bool {
        match self {
            Self::Turn { hue, saturation, lightness } => hue % 360.0 == 0.0 && saturation == 1.0 && lightness == 0.0,
            Self::Ratio { from, to } => from == to,
        }
    }

    /// The colour that an albedo becomes.
    pub fn apply(self, albedo: Vec3) -> Vec3 {
        if self.is_neutral() {
            return albedo;
        }
        match self {
            Self::Ratio { from, to } => albedo * Vec3::from(to) / Vec3::from(from).max(Vec3::splat(1e-3)),
            Self::Turn { hue, saturation, lightness } => {
                let level = luminance(albedo.to_array()) / LEVEL;
                if level <= 0.0 {
                    return albedo;
                }
                let [l, a, b] = lab((albedo / level).to_array().map(f64::from));
                let (sin, cos) = f64::from(hue).to_radians().sin_cos();
                let (chroma, l) = (f64::from(saturation), (l + f64::from(lightness)).clamp(0.0, 200.0));
                let turned = [l, chroma * (cos * a - sin * b), chroma * (sin * a + cos * b)];
                rgb_of_lab(turned).max(Vec3::ZERO) * level
            }
        }
    }
}

/// Linear RGB of a colour in CIE Lab; the inverse of [`lab`].
fn rgb_of_lab([l, a, b]: [f64; 3]) -> Vec3 {
    let f = |t: f64| if t > 6.0 / 29.0 { t.powi(3) } else { (t - 4.0 / 29.0) * 3.0 * (6.0f64 / 29.0).powi(2) };
    let y = (l + 16.0) / 116.0;
    let xyz = [f(y + a / 500.0), f(y), f(y - b / 200.0)];
    // the columns of the matrix of lab(), measured where it is linear in its argument
    let white = |rgb: [f64; 3]| {
        let [l, a, b] = lab(rgb);
        let y = (l + 16.0) / 116.0;
        glam::DVec3::new(f(y + a / 500.0), f(y), f(y - b / 200.0))
    };
    let matrix = glam::DMat3::from_cols(white([1.0, 0.0, 0.0]), white([0.0, 1.0, 0.0]), white([0.0, 0.0, 1.0]));
    (matrix.inverse() * glam::DVec3::from_array(xyz)).as_vec3()
}

impl FromStr for Recolor {
    type Err = Error;

    /// Reads `hue=90,saturation=0.8,lightness=-5`, or `from=e0c030,to=c02020` with colours as in HTML.
    fn from_str(text: &str) -> Result<Self> {
        let wrong = |problem: String| Error::parameter("recolor", problem);
        let mut found = BTreeMap::new();
        for part in text.split(',') {
            let (name, value) =
                part.split_once('=').ok_or_else(|| wrong(format!("found {part:?}, expected name=value")))?;
            if !["hue", "saturation", "lightness", "from", "to"].contains(&name) {
                let names = "hue, saturation, lightness, from and to";
                return Err(wrong(format!("found {name:?}, the names are {names}")));
            }
            found.insert(name, value);
        }
        let number = |name: &str, default: f32, [low, high]: [f32; 2]| match found.get(name) {
            Some(text) => text
                .parse()
                .ok()
                .filter(|v| (low..=high).contains(v))
                .ok_or_else(|| wrong(format!("{name} is {text:?}, expected a number from {low} to {high}"))),
            None => Ok(default),
        };
        match (found.get("from"), found.get("to")) {
            (Some(from), Some(to)) if found.len() == 2 => {
                Ok(Self::Ratio { from: color(from)?.to_array(), to: color(to)?.to_array() })
            }
            (None, None) => Ok(Self::Turn {
                hue: number("hue", 0.0, [-360.0, 360.0])?,
                saturation: number("saturation", 1.0, [0.0, 10.0])?,
                lightness: number("lightness", 0.0, [-100.0, 100.0])?,
            }),
            _ => Err(wrong("from and to are given together, and without hue, saturation and lightness".into())),
        }
    }
}

/// A colour as in HTML, `e0c030` with or without `#`, in linear light.
///
/// # Errors
/// [`Error::Parameter`].
pub fn color(text: &str) -> Result<Vec3> {
    let digits = text.trim_start_matches('#');
    let number = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6);
    let number = number.ok_or_else(|| {
        Error::parameter("color", format!("found {text:?}, expected six hexadecimal digits such as e0c030"))
    })?;
    let [_, rgb @ ..] = number.to_be_bytes();
    Ok(Vec3::from(rgb.map(|byte| Encoding::Srgb.decode(f32::from(byte) / 255.0))))
}

impl Edit {
    /// Whether nothing changes.
    pub fn is_neutral(&self) -> bool {
        Self { recolor: self.recolor.filter(|recolor| !recolor.is_neutral()), ..*self } == Self::default()
    }

    /// Checks that all factors are in range.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the field.
    pub fn check(&self) -> Result<()> {
        let [red, green, blue] = self.tint;
        for (name, value, low, high) in [
            ("gloss", self.gloss, 0.05, 20.0),
            ("highlights", self.highlights, 0.0, 100.0),
            ("contrast", self.contrast, 0.0, 5.0),
            ("tint", red, 0.0, 100.0),
            ("tint", green, 0.0, 100.0),
            ("tint", blue, 0.0, 100.0),
            ("exposure", self.exposure, -10.0, 10.0),
            ("desaturate", self.desaturate, 0.0, 1.0),
        ] {
            if !(low..=high).contains(&value) {
                return Err(Error::parameter(name, format!("found {value}, expected {low} to {high}")));
            }
        }
        Ok(())
    }

    /// Whether diffuse part and highlight change differently.
    fn separates(&self) -> bool {
        !Self { tint: [1.0; 3], exposure: 0.0, desaturate: 0.0, ..*self }.is_neutral()
    }
}

/// A row after an edit, from its apparent values in linear light, shape (view, light).
pub fn edited_row(geometry: &Geometry, values: &[Vec3], edit: &Edit) -> Vec<Vec3> {
    if edit.is_neutral() {
        return values.to_vec();
    }
    let mut values = if edit.separates() { with_parts(geometry, values, edit) } else { values.to_vec() };
    let factor = Vec3::from(edit.tint) * edit.exposure.exp2();
    for value in &mut values {
        let grey = Vec3::splat(luminance(value.to_array()));
        *value = (*value + (grey - *value) * edit.desaturate) * factor;
    }
    values
}

fn with_parts(geometry: &Geometry, values: &[Vec3], edit: &Edit) -> Vec<Vec3> {
    let mut row = Separated::new(geometry, values);
    if edit.gloss == 1.0 {
        // a change of strength alone scales what is measured
        row.specular.iter_mut().for_each(|s| *s *= edit.highlights);
    } else {
        let facets = Facets::new(geometry, &row);
        let alpha = (facets.fit.alpha / edit.gloss).clamp(ALPHA[0], ALPHA[1]);
        row.specular = facets.changed(geometry, &row.specular, facets.fit.strength * edit.highlights, alpha);
    }
    if edit.contrast != 1.0 {
        let albedo = luminance(row.fit.albedo.to_array());
        for (pair, value) in row.diffuse.iter_mut().enumerate() {
            let even = albedo * geometry.light(pair).z.max(0.02);
            let ratio = (luminance(value.to_array()) / even.max(1e-6)).clamp(RATIOS[0], RATIOS[1]);
            *value *= ratio.powf(edit.contrast - 1.0);
        }
    }
    let albedo = edit.recolor.map_or(row.fit.albedo, |recolor| recolor.apply(row.fit.albedo));
    row.with(albedo, &row.specular)
}

/// Edits the chosen rows of a material. Texels that a mask chooses get rows of their own if others share theirs.
///
/// # Errors
/// Errors of the selection, of [`Edit::check`] and of [`Rows::rebuilt`].
pub fn edit(rows: &Rows, selection: &Selection, edit: &Edit) -> Result<MemoryParts> {
    edit.check()?;
    let chosen = selection.rows(rows)?;
    if edit.is_neutral() {
        return MemoryParts::copy(&**rows.parts());
    }
    let geometry = Geometry::new(rows.meta());
    let changed = |(row, origin): &(usize, usize)| (*row, edited_row(&geometry, &rows.values(*origin), edit));
    let changed: BTreeMap<usize, Vec<Vec3>> = chosen.changed.par_iter().map(changed).collect();
    rows.rebuilt(chosen.index.into(), &chosen.origin, &changed)
}
