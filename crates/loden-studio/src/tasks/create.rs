//! New materials: measured by the virtual goniometer, enlarged, exchanged, edited.

use loden::Error;
use loden::acquire;
use loden::direction::DirectionSet;
use loden::generate::{self, Keep, Match, Recolor, Selection};
use loden::job::{self, EditRequest, ExchangeRequest, Features, On, Sample, SampleRequest, Store, SynthesisRequest};
use loden::params::{Given, Params};
use loden::synth;
use serde::Deserialize;
use serde_json::json;

use super::words::Words;
use super::{new_loden, shown};
use crate::Studio;
use crate::failure::Answer;
use crate::jobs::{Job, Work};

/// Clusters of materials that have no rows, as by default on the command line.
const CLUSTERS: usize = 256;

/// Principal components by which a synthesis compares texels, as by default on the command line.
const CHANNELS: usize = 8;

/// Texels per side of what is made, at most: more are for the command line.
const SIDE: usize = 4096;

/// `loden acquire`.
#[derive(Deserialize)]
pub(crate) struct Acquire {
    sample: String,
    params: Given,
    size: usize,
    spp: u32,
    seed: u64,
    name: String,
}

impl Acquire {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        let Self { sample, params, size, spp, seed, name } = self;
        let kinds = job::sample_kinds();
        let kind = kinds.iter().find(|kind| kind.name == sample && !["maps", "mesh"].contains(&kind.name));
        let kind =
            kind.ok_or_else(|| Error::parameter("sample", format!("found {sample:?}, expected a built-in one")))?;
        params.values(kind.params)?;
        let options = acquire::Options { size, spp, seed, ..acquire::Options::default() };
        options.check()?;
        let output = studio.folders.new_output(&name, &["zip"])?;
        let words =
            Words::new("acquire").word(&sample).params(&params, kind.params).flag("size", size).flag("spp", spp);
        let command = words.flag("seed", seed).output(&output);
        let target = output.clone();
        let run = move |job: &Job| {
            let built = SampleRequest { params, ..SampleRequest::new(sample, seed) }.build(job)?;
            job::measure(&built, &DirectionSet::bonn81(), &options, &target, &Given::default(), job)?;
            Ok(json!({ "output": target }))
        };
        Ok(Work { kind: "acquire", title: name, command, output: Some(output), run: Box::new(run) })
    }
}

/// `loden synthesize`.
#[derive(Deserialize)]
pub(crate) struct Synthesize {
    material: String,
    method: String,
    params: Given,
    size: [usize; 2],
    tileable: bool,
    seed: u64,
    name: String,
}

impl Synthesize {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        let path = studio.folders.find(&self.material)?;
        studio.images(&self.material)?;
        let output = new_loden(studio, &self.name)?;
        let method = synth::by_name(&self.method)?;
        let params = self.params.values(method.params())?;
        let [width, height] = self.size;
        if !(1..=SIDE).contains(&width) || !(1..=SIDE).contains(&height) {
            let problem = format!("found {width} x {height}, expected 1 to {SIDE} texels per side");
            return Err(Error::parameter("size", problem).into());
        }
        let words = Words::new("synthesize").path(&path).flag("method", method.name());
        let words = words.params(&self.params, method.params()).flag("size", format!("{width}x{height}"));
        let command = words.switch("tileable", self.tileable).flag("seed", self.seed).output(&output);
        let request = SynthesisRequest {
            sample: Sample::Material(path, Given::default()),
            with: Vec::new(),
            method,
            params,
            size: Some(self.size),
            tileable: self.tileable,
            seed: self.seed,
            mask: None,
            guide: None,
            periodic: false,
            features: Features::Appearance,
            channels: CHANNELS,
            store: Store::Map,
            map: None,
            output: output.clone(),
        };
        let run = move |job: &Job| shown(&job::synthesize(&request, job)?);
        Ok(Work { kind: "synthesize", title: self.name, command, output: Some(output), run: Box::new(run) })
    }
}

/// `loden generate exchange`.
#[derive(Deserialize)]
pub(crate) struct Exchange {
    structure: String,
    reflectance: String,
    /// Whether the pattern keeps its shading.
    shading: bool,
    name: String,
}

impl Exchange {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        let structure = studio.folders.find(&self.structure)?;
        let reflectance = studio.folders.find(&self.reflectance)?;
        for id in [&self.structure, &self.reflectance] {
            studio.images(id)?;
        }
        let output = new_loden(studio, &self.name)?;
        let keep = if self.shading { Keep::Shading } else { Keep::Nothing };
        let words = Words::new("generate exchange").file("structure", &structure).file("reflectance", &reflectance);
        let command = words.flag("keep", keep.name()).output(&output);
        let request = ExchangeRequest {
            structure,
            reflectance,
            options: Given::default(),
            by: Match::Transport,
            epsilon: None,
            split: false,
            keep,
            clusters: CLUSTERS,
            output: output.clone(),
        };
        let run = move |job: &Job| shown(&job::exchange(&request, job)?);
        Ok(Work { kind: "exchange", title: self.name, command, output: Some(output), run: Box::new(run) })
    }
}

/// `loden edit`.
#[derive(Deserialize)]
pub(crate) struct Edit {
    material: String,
    hue: f32,
    saturation: f32,
    gloss: f32,
    highlights: f32,
    contrast: f32,
    exposure: f32,
    /// A texel; what is connected with it and like it is changed. None changes all.
    grow: Option<[usize; 2]>,
    /// How much it may differ, in CIE Lab.
    similar: f64,
    name: String,
}

impl Edit {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        let input = studio.folders.find(&self.material)?;
        studio.images(&self.material)?;
        let output = new_loden(studio, &self.name)?;
        let Self { hue, saturation, gloss, highlights, contrast, exposure, similar, .. } = self;
        let mut words = Words::new("edit").path(&input);
        let recolor = Recolor::Turn { hue, saturation, lightness: 0.0 };
        if !recolor.is_neutral() {
            words = words.flag("recolor", format!("hue={hue},saturation={saturation}"));
        }
        for (name, value, neutral) in [
            ("gloss", gloss, 1.0),
            ("highlights", highlights, 1.0),
            ("contrast", contrast, 1.0),
            ("exposure", exposure, 0.0),
        ] {
            words = if value == neutral { words } else { words.flag(name, value) };
        }
        let selection = match self.grow {
            None => Selection::All,
            Some([x, y]) => {
                words = words.flag("grow", format!("{x},{y}")).flag("similar", similar);
                Selection::Grow { x, y, radius: similar }
            }
        };
        let recolor = (!recolor.is_neutral()).then_some(recolor);
        let edit = generate::Edit { recolor, gloss, highlights, contrast, exposure, ..generate::Edit::default() };
        let on = On::Selection(selection);
        let command = words.output(&output);
        let options = Given::default();
        let request = EditRequest { input, options, on, edit, clusters: CLUSTERS, output: output.clone() };
        let run = move |job: &Job| shown(&job::edit(&request, job)?);
        Ok(Work { kind: "edit", title: self.name, command, output: Some(output), run: Box::new(run) })
    }
}
