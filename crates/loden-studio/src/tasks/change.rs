//! Materials made of others: exchanged, mixed, edited.

use std::path::PathBuf;

use loden::Error;
use loden::generate::{self, Keep, Match, Recolor, Selection};
use loden::job::{self, BlendRequest, EditRequest, ExchangeRequest, On};
use loden::params::Given;
use serde::Deserialize;

use super::mask::{Mask, Painted};
use super::words::Words;
use super::{new_loden, shown};
use crate::Studio;
use crate::failure::Answer;
use crate::jobs::{Job, Work};

/// Clusters of materials that have no rows, as by default on the command line.
pub(super) const CLUSTERS: usize = 256;

/// `loden generate exchange`.
#[derive(Deserialize)]
pub(crate) struct Exchange {
    structure: String,
    reflectance: String,
    /// Whether the pattern keeps its shading.
    shading: bool,
    name: String,
}

/// What the pattern keeps, by a switch of the page.
pub(super) fn keep(shading: bool) -> Keep {
    if shading { Keep::Shading } else { Keep::Nothing }
}

/// An exchange with the defaults of the command line.
pub(super) fn exchange(structure: PathBuf, reflectance: PathBuf, keep: Keep, output: PathBuf) -> ExchangeRequest {
    let (options, by, clusters) = (Given::default(), Match::Transport, CLUSTERS);
    ExchangeRequest { structure, reflectance, options, by, epsilon: None, split: false, keep, clusters, output }
}

impl Exchange {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        let structure = studio.folders.find(&self.structure)?;
        let reflectance = studio.folders.find(&self.reflectance)?;
        for id in [&self.structure, &self.reflectance] {
            studio.images(id)?;
        }
        let output = new_loden(studio, &self.name)?;
        let keep = keep(self.shading);
        let words = Words::new("generate exchange").file("structure", &structure).file("reflectance", &reflectance);
        let command = words.flag("keep", keep.name()).output(&output);
        let request = exchange(structure, reflectance, keep, output.clone());
        let run = move |job: &Job| shown(&job::exchange(&request, job)?);
        Ok(Work { kind: "exchange", title: self.name, command, output: Some(output), run: Box::new(run) })
    }
}

/// `loden generate blend`.
#[derive(Deserialize)]
pub(crate) struct Blend {
    first: String,
    second: String,
    amount: f32,
    /// Where the second is mixed in; everywhere without.
    mask: Option<Painted>,
    name: String,
}

impl Blend {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        let (first, second) = (studio.folders.find(&self.first)?, studio.folders.find(&self.second)?);
        for id in [&self.first, &self.second] {
            studio.images(id)?;
        }
        if !(0.0..=1.0).contains(&self.amount) {
            return Err(Error::parameter("amount", format!("found {}, expected 0 to 1", self.amount)).into());
        }
        let output = new_loden(studio, &self.name)?;
        let mask = self.mask.map(|painted| painted.beside(studio, &output)).transpose()?;
        let words = Words::new("generate blend").path(&first).path(&second).flag("amount", self.amount);
        let words = mask.iter().fold(words, |words, mask| words.file("mask", &mask.path));
        let command = words.output(&output);
        let file = mask.as_ref().map(|mask| mask.path.clone());
        let (options, amount, clusters) = (Given::default(), self.amount, CLUSTERS);
        let request = BlendRequest { first, second, options, amount, mask: file, clusters, output: output.clone() };
        let run = move |job: &Job| shown(&with(mask.as_ref(), || job::blend(&request, job))?);
        Ok(Work { kind: "blend", title: self.name, command, output: Some(output), run: Box::new(run) })
    }
}

/// Does some work that needs the file of a mask.
fn with<T>(mask: Option<&Mask>, work: impl FnOnce() -> loden::Result<T>) -> loden::Result<T> {
    match mask {
        Some(mask) => mask.during(work),
        None => work(),
    }
}

/// `loden edit`.
#[derive(Deserialize)]
pub(crate) struct Edit {
    material: String,
    #[serde(flatten)]
    change: Change,
    on: Where,
    name: String,
}

/// What changes.
#[derive(Debug, Clone, Copy, Deserialize)]
pub(crate) struct Change {
    hue: f32,
    saturation: f32,
    gloss: f32,
    highlights: f32,
    contrast: f32,
    exposure: f32,
}

impl Change {
    fn recolor(&self) -> Option<Recolor> {
        let recolor = Recolor::Turn { hue: self.hue, saturation: self.saturation, lightness: 0.0 };
        (!recolor.is_neutral()).then_some(recolor)
    }

    /// As the library has it.
    pub fn edit(&self) -> generate::Edit {
        let Self { gloss, highlights, contrast, exposure, .. } = *self;
        generate::Edit { recolor: self.recolor(), gloss, highlights, contrast, exposure, ..generate::Edit::default() }
    }

    /// Its flags.
    fn words(&self, mut words: Words) -> Words {
        if self.recolor().is_some() {
            words = words.flag("recolor", format!("hue={},saturation={}", self.hue, self.saturation));
        }
        for (name, value, neutral) in [
            ("gloss", self.gloss, 1.0),
            ("highlights", self.highlights, 1.0),
            ("contrast", self.contrast, 1.0),
            ("exposure", self.exposure, 0.0),
        ] {
            words = if value == neutral { words } else { words.flag(name, value) };
        }
        words
    }
}

/// What is changed.
#[derive(Debug, Clone, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Where {
    All,
    /// Rows by their numbers.
    Rows(Vec<usize>),
    /// Rows whose mean colour is near one; the colour as in HTML.
    Colors {
        center: String,
        radius: f64,
    },
    /// What is connected with a texel and like it, in CIE Lab.
    Grow {
        texel: [usize; 2],
        similar: f64,
    },
    Mask(Painted),
}

impl Where {
    /// As the library has it.
    pub fn selection(&self) -> loden::Result<Selection> {
        Ok(match self {
            Self::All => Selection::All,
            Self::Rows(rows) => Selection::Rows(rows.clone()),
            Self::Colors { center, radius } => Selection::Colors { center: generate::color(center)?, radius: *radius },
            Self::Grow { texel: [x, y], similar } => Selection::Grow { x: *x, y: *y, radius: *similar },
            Self::Mask(painted) => Selection::Mask(painted.texels()?),
        })
    }

    fn words(&self, words: Words) -> Words {
        match self {
            Self::All | Self::Mask(_) => words,
            Self::Rows(rows) => words.flag("rows", rows.iter().map(usize::to_string).collect::<Vec<_>>().join(",")),
            Self::Colors { center, radius } => words.flag("colors", format!("{center},{radius}")),
            Self::Grow { texel: [x, y], similar } => words.flag("grow", format!("{x},{y}")).flag("similar", similar),
        }
    }
}

impl Edit {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        let input = studio.folders.find(&self.material)?;
        studio.images(&self.material)?;
        let output = new_loden(studio, &self.name)?;
        let words = self.on.words(self.change.words(Words::new("edit").path(&input)));
        // wrong numbers are refused before the job
        let selection = self.on.selection()?;
        let (mask, on) = match self.on {
            Where::Mask(painted) => {
                let mask = painted.beside(studio, &output)?;
                let path = mask.path.clone();
                (Some(mask), On::Mask(path))
            }
            _ => (None, On::Selection(selection)),
        };
        let words = mask.iter().fold(words, |words, mask| words.file("mask", &mask.path));
        let (edit, options, command) = (self.change.edit(), Given::default(), words.output(&output));
        let request = EditRequest { input, options, on, edit, clusters: CLUSTERS, output: output.clone() };
        let run = move |job: &Job| shown(&with(mask.as_ref(), || job::edit(&request, job))?);
        Ok(Work { kind: "edit", title: self.name, command, output: Some(output), run: Box::new(run) })
    }
}
