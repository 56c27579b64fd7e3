//! Compressed materials and exports.

use loden::codec::{self, Finish, Goal};
use loden::job::{self, CompressRequest};
use loden::params::Given;
use loden::renderers;
use serde::Deserialize;

use super::words::Words;
use super::{new_loden, shown};
use crate::Studio;
use crate::failure::Answer;
use crate::jobs::{Job, Work};

/// `loden compress`.
#[derive(Deserialize)]
pub(crate) struct Compress {
    material: String,
    method: String,
    params: Given,
    /// What parameters to search for; none takes them as they are.
    goal: Option<Aim>,
    name: String,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Aim {
    Quality(u8),
    Bytes(u64),
    MaxError(f64),
}

impl Compress {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        let source = studio.images(&self.material)?;
        let path = studio.folders.find(&self.material)?;
        let output = new_loden(studio, &self.name)?;
        let codec = codec::by_name(&self.method)?;
        let params = self.params.values(codec.params())?;
        let words = Words::new("compress").path(&path).flag("method", codec.name());
        let words = words.params(&self.params, codec.params());
        let (goal, words) = match self.goal {
            None => (Goal::Params, words),
            Some(Aim::Quality(quality)) => (Goal::of_quality(quality.clamp(1, 100)), words.flag("quality", quality)),
            Some(Aim::Bytes(bytes)) => (Goal::Bytes(bytes), words.flag("bytes", bytes)),
            Some(Aim::MaxError(error)) => (Goal::MaxError(error), words.flag("max-error", error)),
        };
        let target = output.clone();
        let run = move |job: &Job| {
            let finish = Finish { measure: true, lossless: None };
            let request = CompressRequest { codec, params, goal, finish, memory: None };
            shown(&job::compress(&*source, &request, &target, job)?)
        };
        let command = words.output(&output);
        Ok(Work { kind: "compress", title: self.name, command, output: Some(output), run: Box::new(run) })
    }
}

/// `loden export`.
#[derive(Deserialize)]
pub(crate) struct Export {
    material: String,
    renderer: String,
    name: String,
}

impl Export {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        let path = studio.folders.find(&self.material)?;
        let renderer = renderers::by_name(&self.renderer)?;
        renderer.check(&path, &*codec::open(&path)?)?;
        let output = studio.folders.new_output(&self.name, &[])?;
        let command = Words::new("export").path(&path).flag("to", renderer.name()).output(&output);
        let target = output.clone();
        let run = move |job: &Job| shown(&job::export_to(&path, &Given::default(), renderer, &target, job)?);
        Ok(Work { kind: "export", title: self.name, command, output: Some(output), run: Box::new(run) })
    }
}
