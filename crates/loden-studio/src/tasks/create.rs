//! New materials: measured by the virtual goniometer, enlarged.

use loden::Error;
use loden::acquire;
use loden::direction::DirectionSet;
use loden::job::{self, Features, Sample, SampleRequest, Store, SynthesisRequest};
use loden::params::{Given, Params};
use loden::synth;
use serde::Deserialize;
use serde_json::json;

use super::growth::{Watched, frontal};
use super::words::Words;
use super::{new_loden, shown};
use crate::Studio;
use crate::failure::Answer;
use crate::jobs::{Job, Work};

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
        let source = studio.images(&self.material)?;
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
        let run = move |job: &Job| {
            let watched = Watched::new(job, frontal(&*source)?);
            shown(&job::synthesize(&request, &watched)?)
        };
        Ok(Work { kind: "synthesize", title: self.name, command, output: Some(output), run: Box::new(run) })
    }
}
