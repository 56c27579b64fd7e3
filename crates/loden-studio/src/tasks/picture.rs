//! Pictures by the path tracer, shown while they become less noisy.

use std::path::{Path, PathBuf};

use loden::job::{self, Limits, Render, Subject};
use loden::progress::Progress;
use loden::{Error, Result};
use serde::Deserialize;
use serde_json::{Value, json};

use super::words::Words;
use crate::Studio;
use crate::failure::Answer;
use crate::images::encoded;
use crate::jobs::{Job, Work};
use crate::scene::{Lighting, Look};

/// The most samples per pixel, and pixels per side.
const SAMPLES: u32 = 1024;
const SIDE: usize = 2048;

/// `loden render --scene`, of the view that the page shows.
#[derive(Deserialize)]
pub(crate) struct Picture {
    look: Look,
    spp: u32,
}

impl Picture {
    pub(super) fn work(self, studio: &Studio) -> Answer<Work> {
        let Self { look, spp } = self;
        let material = studio.folders.find(&look.material)?;
        if !(1..=SAMPLES).contains(&spp) {
            return Err(Error::parameter("spp", format!("found {spp}, expected 1 to {SAMPLES}")).into());
        }
        if look.size.iter().any(|side| !(1..=SIDE).contains(side)) {
            return Err(Error::parameter("size", format!("found {:?}, expected 1 to {SIDE} pixels", look.size)).into());
        }
        let scene = look.toml(studio, spp)?;
        let title = format!("{}, {}", material.file_stem().unwrap_or_default().to_string_lossy(), look.object);
        let command = Words::new("render").file("scene", Path::new("scene.toml")).output(Path::new("picture.png"));
        let soft = look.lighting == Lighting::Studio;
        let run = move |job: &Job| refine(&scene, soft, spp, job);
        Ok(Work { kind: "picture", title, command, output: None, run: Box::new(run) })
    }
}

/// Renders with 1, 4, 16, ... samples per pixel, each time from the samples so far.
fn refine(text: &str, soft: bool, spp: u32, job: &Job) -> Result<Value> {
    let folder = tempfile::tempdir().map_err(Error::io(std::env::temp_dir()))?;
    let (scene, checkpoint) = (folder.path().join("scene.toml"), folder.path().join("samples"));
    std::fs::write(&scene, text).map_err(Error::io(&scene))?;
    let mut samples = 1;
    loop {
        let samples_now = u32::min(samples, spp);
        job.stage(&format!("{samples_now} of {spp} samples per pixel"));
        let picture = step(soft, &scene, &checkpoint, samples_now, job)?;
        job.show(picture);
        if samples_now == spp {
            return Ok(json!({ "spp": spp }));
        }
        samples *= 4;
    }
}

fn step(soft: bool, scene: &Path, checkpoint: &Path, spp: u32, job: &Job) -> Result<Vec<u8>> {
    let render = Render {
        subject: Subject::Scene { file: scene.into(), texture_samples: None, world: None, shadows: None },
        size: None,
        spp: Some(spp),
        depth: None,
        seed: 0,
        // what the browser draws is compared with a picture that is not denoised
        denoise: soft,
        limits: Limits { checkpoint: Some(checkpoint.into()), ..Limits::default() },
        memory: None,
        scratch: PathBuf::from("."),
    };
    let picture = job::render(&render, job)?.rendered.picture;
    encoded(&picture).map_err(|failure| Error::parameter("picture", failure.message()))
}
