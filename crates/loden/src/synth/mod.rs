//! Materials larger than the sample: from what a few centimetres look like, a surface of any size.
//!
//! A method is one file, listed in [`SYNTHESES`]. It compares texels by an [`Exemplar`], and all it gives is a
//! [`SourceMap`]: for each texel of the result, the texel of the sample that it copies. So the values of a material stay
//! what was measured, and one map serves every plane of any codec, and any picture of the same sample.
//!
//! # Model
//! Near every texel of the result, the copied texels look like a neighbourhood of the sample; methods differ in what they
//! call near, and in how they search.
//!
//! # References
//! efros1999, wei2000, efros2001, liang2001

mod blocks;
mod efros_leung;
mod endless;
mod features;
mod fft;
mod height;
pub mod map;
mod matching;
pub mod measure;
mod normal;
mod optimise;
mod patches;
mod quilting;
pub mod surface;
mod tiling;
mod wei_levoy;

pub use crate::codec::{Source, SourceMap};
use crate::params::{Param, Values};
use crate::progress::Progress;
use crate::{Error, Result};
pub use endless::Endless;
pub use height::Relief;

/// All methods.
pub const SYNTHESES: &[&dyn Synthesis] = &[
    &optimise::Optimise,
    &tiling::Tiling,
    &efros_leung::EfrosLeung,
    &wei_levoy::WeiLevoy,
    &quilting::Quilting,
    &patches::Patches,
];

/// The method that is used where none is named.
pub const DEFAULT: &str = "optimise";

/// The largest width and height of exemplars, whose coordinates are 16-bit numbers.
pub const MAX_SIDE: usize = 1 << 16;

/// The most texels of a result; the map takes four bytes for each.
pub const MAX_TEXELS: usize = 1 << 28;

/// A method that rearranges the texels of an exemplar.
pub trait Synthesis: Sync {
    /// Name on the command line.
    fn name(&self) -> &'static str;

    /// One sentence for the reference page.
    fn doc(&self) -> &'static str;

    /// Its parameters.
    fn params(&self) -> &'static [Param];

    /// Whether it can fill what is not known ([`Goal::known`]).
    fn fills(&self) -> bool {
        false
    }

    /// Whether it can follow a guide ([`Goal::guide`]).
    fn guides(&self) -> bool {
        false
    }

    /// Makes the map. Exemplar and goal are valid: call [`synthesize`], which checks them. The same arguments give the same
    /// map, for any number of threads.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `params` are not those of [`Synthesis::params`], or do not suit the exemplar;
    /// [`Error::Cancelled`].
    fn synthesize(
        &self,
        exemplar: &Exemplar,
        goal: &Goal,
        params: &Values,
        progress: &dyn Progress,
    ) -> Result<SourceMap>;
}

/// The method of this name.
///
/// # Errors
/// [`Error::Parameter`] listing the known names.
pub fn by_name(name: &str) -> Result<&'static dyn Synthesis> {
    SYNTHESES.iter().copied().find(|method| method.name() == name).ok_or_else(|| {
        let names: Vec<_> = SYNTHESES.iter().map(|method| method.name()).collect();
        Error::parameter("method", format!("found {name:?}, expected one of {}", names.join(", ")))
    })
}

/// Checks exemplar and goal, and makes the map by this method.
///
/// # Errors
/// [`Error::Parameter`] naming what is wrong; [`Error::NonFinite`] if the exemplar is not finite; see also
/// [`Synthesis::synthesize`].
pub fn synthesize(
    method: &dyn Synthesis,
    exemplar: &Exemplar,
    goal: &Goal,
    params: &Values,
    progress: &dyn Progress,
) -> Result<SourceMap> {
    exemplar.check()?;
    goal.check()?;
    let able = |can: bool, what: &str, others: fn(&dyn Synthesis) -> bool| {
        let others = || SYNTHESES.iter().filter(|method| others(**method)).map(|method| method.name());
        let problem =
            || format!("{} cannot {what}, expected {}", method.name(), others().collect::<Vec<_>>().join(" or "));
        if can { Ok(()) } else { Err(Error::parameter("method", problem())) }
    };
    if let Some(known) = &goal.known {
        able(method.fills(), "fill what is not known", |method| method.fills())?;
        let inside =
            |source: &Source| usize::from(source.x) < exemplar.width && usize::from(source.y) < exemplar.height;
        if known.len() != goal.width * goal.height || !known.iter().flatten().all(inside) {
            return Err(Error::parameter("known", "expected a texel of the exemplar or none for every texel"));
        }
    }
    if let Some(guide) = &goal.guide {
        able(method.guides(), "follow a guide", |method| method.guides())?;
        let lengths = (guide.sample.len(), guide.result.len());
        let numbers = guide.sample.iter().chain(&guide.result).chain([&guide.weight]);
        if lengths != (exemplar.width * exemplar.height, goal.width * goal.height)
            || !numbers.clone().all(|v| v.is_finite())
        {
            return Err(Error::parameter("guide", "expected a number for every texel of the sample and of the result"));
        }
    }
    method.synthesize(exemplar, goal, params, progress)
}

/// What texels of a sample are compared by: a few numbers for each, whose squared differences add up to the distance
/// between two texels.
#[derive(Debug, Clone, PartialEq)]
pub struct Exemplar {
    /// Texels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Numbers per texel.
    pub channels: usize,
    /// The numbers, shape (y, x, channel).
    pub values: Vec<f32>,
    /// Whether the sample continues at its opposite edges.
    pub periodic: bool,
    /// The texels that may be copied, shape (y, x); all without a mask.
    pub mask: Option<Vec<bool>>,
    /// How often each texel is to be used, relative to others, shape (y, x); all alike without. Only `optimise` follows them.
    pub weights: Option<Vec<f32>>,
}

impl Exemplar {
    /// An exemplar that is not periodic and has no mask.
    pub fn new(width: usize, height: usize, channels: usize, values: Vec<f32>) -> Self {
        Self { width, height, channels, values, periodic: false, mask: None, weights: None }
    }

    /// The numbers of a texel.
    ///
    /// # Panics
    /// If the texel is outside.
    #[inline]
    pub fn texel(&self, x: usize, y: usize) -> &[f32] {
        &self.values[(y * self.width + x) * self.channels..][..self.channels]
    }

    /// Whether a texel may be copied.
    ///
    /// # Panics
    /// If the texel is outside.
    #[inline]
    pub fn is_usable(&self, x: usize, y: usize) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask[y * self.width + x])
    }

    /// The squared distance between two texels.
    ///
    /// # Panics
    /// If a texel is outside.
    #[inline]
    pub fn distance(&self, a: Source, b: Source) -> f32 {
        let (a, b) = (self.texel(a.x.into(), a.y.into()), self.texel(b.x.into(), b.y.into()));
        a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
    }

    /// The mean squared distance of the texels from their mean.
    pub fn variance(&self) -> f64 {
        let texels = (self.width * self.height) as f64;
        let of_channel = |channel: usize| {
            let values = self.values[channel..].iter().step_by(self.channels).map(|&v| f64::from(v));
            let mean = values.clone().sum::<f64>() / texels;
            values.map(|v| (v - mean).powi(2)).sum::<f64>() / texels
        };
        (0..self.channels).map(of_channel).sum()
    }

    /// Checks sizes and values.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming what is wrong; [`Error::NonFinite`].
    pub fn check(&self) -> Result<()> {
        for (name, side) in [("width", self.width), ("height", self.height)] {
            if !(1..=MAX_SIDE).contains(&side) {
                let problem = format!("found {side} texels, expected 1 to {MAX_SIDE}");
                return Err(Error::parameter(format!("{name} of the exemplar"), problem));
            }
        }
        let texels = self.width * self.height;
        let lengths = [("values", self.values.len(), texels.saturating_mul(self.channels))];
        let mask = self.mask.iter().map(|mask| ("mask", mask.len(), texels));
        for (name, found, expected) in lengths.into_iter().chain(mask) {
            if found != expected || self.channels == 0 {
                let problem = format!("found {found} of {} channels, expected {expected}", self.channels);
                return Err(Error::parameter(format!("{name} of the exemplar"), problem));
            }
        }
        if self
            .weights
            .as_ref()
            .is_some_and(|all| all.len() != texels || !all.iter().all(|w| w.is_finite() && *w > 0.0))
        {
            return Err(Error::parameter("weights of the exemplar", "expected a positive number for every texel"));
        }
        if self.mask.as_ref().is_some_and(|mask| !mask.contains(&true)) {
            return Err(Error::parameter("mask", "leaves no texel of the exemplar"));
        }
        if !self.values.iter().all(|v| v.is_finite()) {
            return Err(Error::non_finite("the exemplar"));
        }
        Ok(())
    }
}

/// What to make.
#[derive(Debug, Clone, PartialEq)]
pub struct Goal {
    /// Texels per row of the result.
    pub width: usize,
    /// Rows of the result.
    pub height: usize,
    /// Whether the result continues at its opposite edges.
    pub tileable: bool,
    /// Chooses one of many results.
    pub seed: u64,
    /// Texels whose source is given, shape (y, x): the others are filled. Only for methods that can
    /// ([`Synthesis::fills`]).
    pub known: Option<Vec<Option<Source>>>,
    /// What the result resembles from afar. Only for methods that can ([`Synthesis::guides`]).
    pub guide: Option<Guide>,
}

/// A number for every texel: sources are chosen so that those of the result are matched.
#[derive(Debug, Clone, PartialEq)]
pub struct Guide {
    /// The number of each texel of the sample, shape (y, x).
    pub sample: Vec<f32>,
    /// The number wanted at each texel of the result, shape (y, x).
    pub result: Vec<f32>,
    /// The weight of squared differences against those of neighbourhoods whose texels have unit variance.
    pub weight: f32,
}

impl Goal {
    /// A result of this size that need not be tileable, with seed 0.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, tileable: false, seed: 0, known: None, guide: None }
    }

    /// Checks the size.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    pub fn check(&self) -> Result<()> {
        let texels = self.width.checked_mul(self.height);
        if texels.is_some_and(|texels| (1..=MAX_TEXELS).contains(&texels)) {
            return Ok(());
        }
        let problem = format!("found {} x {}, expected 1 to {MAX_TEXELS} texels", self.width, self.height);
        Err(Error::parameter("size", problem))
    }
}

#[cfg(test)]
mod tests;
