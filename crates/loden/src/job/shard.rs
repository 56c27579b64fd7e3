//! Compression by many processes that share a folder.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::compress::{Compression, compression};
use crate::btf::{BtfSource, Origin};
use crate::codec::{self, Finish, Goal, compress_in_stages, lossless};
use crate::import;
use crate::memory::{self, Memory};
use crate::output::{self, failed};
use crate::params::Given;
use crate::progress::Progress;
use crate::stages::files::{Folder, Wait, Waiting, run_task, tasks};
use crate::{Error, Result};

/// A compression that is divided into tasks. Every process reads it from the folder of the job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShardPlan {
    /// The source.
    pub source: Origin,
    /// The file to write, absolute.
    pub output: PathBuf,
    /// The codec.
    pub method: String,
    /// Its given parameters.
    pub params: Given,
    /// The goal of the search for parameters.
    pub goal: ShardGoal,
    /// Whether the error is measured and stored.
    pub measure: bool,
    /// The lossless stage, if there is one.
    pub lossless: Option<String>,
    /// Largest number of tasks of a stage.
    pub tasks: usize,
    /// Memory limit of each process in bytes.
    pub memory: Option<u64>,
}

/// See [`Goal`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShardGoal {
    /// The given parameters.
    Params,
    /// The smallest file of at most this mean error.
    MaxError(f64),
    /// The smallest error in at most this many bytes.
    Bytes(u64),
}

impl From<Goal> for ShardGoal {
    fn from(goal: Goal) -> Self {
        match goal {
            Goal::Params => Self::Params,
            Goal::MaxError(error) => Self::MaxError(error),
            Goal::Bytes(bytes) => Self::Bytes(bytes),
        }
    }
}

/// What is to be done next.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShardNext {
    /// The tasks of a stage.
    Tasks(Waiting),
    /// Nothing: the file is written.
    Done(Box<Compression>),
}

const PLAN: &str = "plan.json";

impl ShardPlan {
    /// A plan for a source that was opened from a file.
    ///
    /// # Errors
    /// [`Error::Parameter`] if it was not, or the method has no stages or other parameters; [`Error::Io`].
    #[expect(clippy::too_many_arguments, reason = "what is asked for, and how")]
    pub fn new(
        source: &dyn BtfSource,
        output: &Path,
        method: &str,
        params: Given,
        goal: Goal,
        finish: Finish,
        tasks: usize,
        memory: Option<Memory>,
    ) -> Result<Self> {
        let codec = codec::by_name(method)?;
        params.values(codec.params())?;
        codec::check_stages(codec)?;
        let source = source.origin().ok_or_else(|| {
            Error::parameter("source", "other processes must open it: a file or folder of a measurement is expected")
        })?;
        Ok(Self {
            source,
            output: std::path::absolute(output).map_err(Error::io(output))?,
            method: method.into(),
            params,
            goal: goal.into(),
            measure: finish.measure,
            lossless: finish.lossless.map(|stage| stage.name.into()),
            tasks,
            memory: memory.map(|Memory(bytes)| bytes),
        })
    }

    /// Writes the plan into a new folder.
    ///
    /// # Errors
    /// [`Error::Exists`]; [`Error::Io`].
    pub fn write(&self, folder: &Path) -> Result<()> {
        fs::create_dir(folder).map_err(|e| match e.kind() {
            std::io::ErrorKind::AlreadyExists => Error::Exists { path: folder.into() },
            _ => failed(folder)(e),
        })?;
        let text = crate::stages::settings(self)?;
        output::write_file(folder.join(PLAN), |file| file.write_all(text.as_bytes()))
    }

    /// Reads the plan of a folder.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Invalid`].
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(PLAN);
        let text = fs::read_to_string(&path).map_err(Error::io(&path))?;
        serde_json::from_str(&text).map_err(|e| Error::invalid(&path, "plan", e.to_string()))
    }

    /// Opens the source.
    ///
    /// # Errors
    /// Errors of the importer.
    pub fn open(&self) -> Result<std::sync::Arc<dyn BtfSource>> {
        import::reopen(&self.source)?
            .images()
            .map_err(|_| Error::unsupported(&self.source.path, "it holds a BRDF, a BTF is needed here"))
    }

    /// Runs the algorithm, which waits for the tasks of every stage, and writes the file: the same as that of
    /// [`super::compress()`], byte for byte. Results of tasks are kept if `keep`.
    ///
    /// # Errors
    /// As [`super::compress()`]; errors of `wait`.
    pub fn compress(&self, folder: &Path, keep: bool, wait: Wait, progress: &dyn Progress) -> Result<Compression> {
        memory::reset_peak();
        let start = Instant::now();
        let (codec, source) = (codec::by_name(&self.method)?, self.open()?);
        let goal = match self.goal {
            ShardGoal::Params => Goal::Params,
            ShardGoal::MaxError(error) => Goal::MaxError(error),
            ShardGoal::Bytes(bytes) => Goal::Bytes(bytes),
        };
        let lossless = self.lossless.as_deref().map(lossless::by_name).transpose()?;
        let (params, finish) = (self.params.values(codec.params())?, Finish { measure: self.measure, lossless });
        let stages = Folder::new(folder, source.as_ref(), self.tasks, keep, wait);
        let done = compress_in_stages(codec, &stages, &params, goal, finish, &self.output, progress)?;
        Ok(compression(source.as_ref(), codec, &self.output, done, start, progress))
    }
}

/// Runs one task of a stage, on the threads of the current pool; a task that has a result already is not run again.
///
/// This is the function of every worker, whatever starts it: a scheduler of clusters, an array of batch jobs, a shell.
/// `source` is what [`ShardPlan::open`] returned.
///
/// # Errors
/// As [`run_task`].
pub fn run_shard(
    folder: &Path,
    plan: &ShardPlan,
    source: &dyn BtfSource,
    [stage, task]: [usize; 2],
    progress: &dyn Progress,
) -> Result<()> {
    run_task(folder, [stage, task], source, codec::kernel, plan.memory.map(Memory), progress)
}

/// The number of tasks of a stage.
///
/// # Errors
/// [`Error::Io`] if there is no such stage.
pub fn shard_tasks(folder: &Path, stage: usize) -> Result<usize> {
    tasks(folder, stage)
}

/// Combines the results in a folder as far as there are any: prepares the next stage, or writes the file and removes the
/// folder.
///
/// # Errors
/// As [`ShardPlan::compress`].
pub fn next_shards(folder: &Path, progress: &dyn Progress) -> Result<ShardNext> {
    let plan = ShardPlan::read(folder)?;
    let found = Mutex::new(None);
    let wait = |waiting: &Waiting| {
        if let Ok(mut found) = found.lock() {
            *found = Some(waiting.clone());
        }
        Err(Error::Cancelled)
    };
    let done = plan.compress(folder, true, &wait, progress);
    if let Some(waiting) = found.into_inner().ok().flatten() {
        return Ok(ShardNext::Tasks(waiting));
    }
    let done = done?;
    fs::remove_dir_all(folder).map_err(Error::io(folder))?;
    Ok(ShardNext::Done(Box::new(done)))
}
