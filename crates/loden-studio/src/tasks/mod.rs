//! What the page may ask for, as jobs of the library. Each has a command line that does the same.

mod change;
mod compress;
mod create;
mod growth;
mod mask;
mod mixing;
mod picture;
mod words;

use std::path::PathBuf;

use loden::Result;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::Studio;
use crate::failure::Answer;
use crate::jobs::Work;

pub(crate) use change::{Change, Where};
pub(crate) use growth::frontal;

/// A job that the page asks for.
#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub(crate) enum Request {
    Acquire(create::Acquire),
    Blend(change::Blend),
    Compress(compress::Compress),
    Edit(change::Edit),
    Exchange(change::Exchange),
    Export(compress::Export),
    Grid(mixing::Grid),
    Picture(picture::Picture),
    Steps(mixing::Steps),
    Synthesize(create::Synthesize),
}

impl Request {
    /// The job, after a check of all that can be checked before it runs.
    pub fn work(self, studio: &Studio) -> Answer<Work> {
        match self {
            Self::Acquire(request) => request.work(studio),
            Self::Blend(request) => request.work(studio),
            Self::Compress(request) => request.work(studio),
            Self::Edit(request) => request.work(studio),
            Self::Exchange(request) => request.work(studio),
            Self::Export(request) => request.work(studio),
            Self::Grid(request) => request.work(studio),
            Self::Picture(request) => request.work(studio),
            Self::Steps(request) => request.work(studio),
            Self::Synthesize(request) => request.work(studio),
        }
    }
}

/// A new `.loden` file.
fn new_loden(studio: &Studio, name: &str) -> Answer<PathBuf> {
    studio.folders.new_output(name, &["loden"])
}

/// A result for the page.
fn shown(result: &impl Serialize) -> Result<Value> {
    Ok(serde_json::to_value(result).unwrap_or_default())
}
