//! Long work in stages of many units, which may run in this process or in others.
//!
//! # Model
//! An algorithm that reads a whole BTF several times asks for one [`Stage`] after the other. A stage is a [`Kernel`], a
//! pure function of the source, of a range of units and of what is [`Known`] from the stages before. A unit is a view or a
//! part of the texels, and gives a small [`Piece`]. [`Stages`] runs all units of a stage; how it distributes them does not
//! change a bit, because pieces are those of units, and the algorithm combines them in the order of units.
//!
//! [`Local`] runs all units at once, on the threads of this process; [`files::Folder`] waits for other processes, which
//! share a folder.

pub mod files;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::btf::{BtfMeta, BtfSource};
use crate::memory::Memory;
use crate::progress::Task;
use crate::{Error, Result};

/// The result of one unit.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Piece {
    /// Numbers for the algorithm.
    pub doubles: Vec<f64>,
    /// Numbers for the algorithm.
    pub floats: Vec<f32>,
    /// Numbers for the kernels of later stages, which stay where they are until then: [`Site::kept`].
    pub kept: Vec<f32>,
}

/// What a kernel has to know, apart from the source.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Known<'a> {
    /// Settings as JSON.
    pub settings: String,
    /// Arrays; their meaning is that of the kernel.
    pub doubles: Vec<Cow<'a, [f64]>>,
    /// As `doubles`.
    pub floats: Vec<Cow<'a, [f32]>>,
    /// As `doubles`.
    pub indices: Vec<Cow<'a, [u32]>>,
}

impl Known<'_> {
    /// Size of the arrays in bytes.
    pub fn bytes(&self) -> u64 {
        let doubles: usize = self.doubles.iter().map(|values| 8 * values.len()).sum();
        let floats: usize = self.floats.iter().map(|values| 4 * values.len()).sum();
        let indices: usize = self.indices.iter().map(|values| 4 * values.len()).sum();
        (doubles + floats + indices) as u64
    }

    /// An array of `doubles`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if it is missing.
    pub fn double(&self, index: usize) -> Result<&[f64]> {
        self.doubles.get(index).map(AsRef::as_ref).ok_or_else(|| missing("doubles", index))
    }

    /// An array of `floats`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if it is missing.
    pub fn float(&self, index: usize) -> Result<&[f32]> {
        self.floats.get(index).map(AsRef::as_ref).ok_or_else(|| missing("floats", index))
    }

    /// An array of `indices`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if it is missing.
    pub fn index(&self, index: usize) -> Result<&[u32]> {
        self.indices.get(index).map(AsRef::as_ref).ok_or_else(|| missing("indices", index))
    }

    /// The settings as a value.
    ///
    /// # Errors
    /// [`Error::Parameter`] if they are not those of the kernel.
    pub fn settings<T: serde::de::DeserializeOwned>(&self) -> Result<T> {
        serde_json::from_str(&self.settings).map_err(|e| Error::parameter("stage", format!("settings: {e}")))
    }
}

fn missing(kind: &str, index: usize) -> Error {
    Error::parameter("stage", format!("array {index} of {kind} is missing"))
}

/// Settings as JSON.
///
/// # Errors
/// [`Error::Parameter`] if they cannot be written.
pub fn settings(value: &impl serde::Serialize) -> Result<String> {
    serde_json::to_string(value).map_err(|e| Error::parameter("stage", e.to_string()))
}

/// Where a kernel runs.
pub struct Site<'a> {
    /// The BTF.
    pub source: &'a dyn BtfSource,
    /// Advanced while the kernel works.
    pub task: &'a Task<'a>,
    /// The numbers that a unit of an earlier stage, given by its number, has kept.
    pub kept: &'a (dyn Fn(usize, usize) -> Result<Arc<Vec<f32>>> + Sync),
}

/// Receives the piece of a unit.
pub type Each<'a> = &'a (dyn Fn(usize, Piece) -> Result<()> + Sync);

/// A pure function of a source and of what is known, for any range of units.
pub trait Kernel: Sync {
    /// Its name in files.
    fn name(&self) -> &'static str;

    /// Upper bound on the memory in bytes, apart from the program and from what is known, for `units` on this many threads.
    fn memory(&self, meta: &BtfMeta, known: &Known, units: Range<usize>, threads: usize) -> u64;

    /// Calls `each` with the piece of every unit, on the threads of the current pool. Pieces do not depend on the range of
    /// units that they are computed with.
    ///
    /// # Errors
    /// Errors of the source and of `each`; [`Error::Parameter`] if what is known is not what the kernel needs;
    /// [`Error::Cancelled`].
    fn run(&self, site: &Site, known: &Known, units: Range<usize>, each: Each) -> Result<()>;
}

/// A kernel with what it has to know, to be run for all units.
pub struct Stage<'a> {
    /// The function.
    pub kernel: &'static dyn Kernel,
    /// What it has to know.
    pub known: Known<'a>,
    /// Number of units.
    pub units: usize,
    /// Steps of progress of all units together.
    pub steps: u64,
}

/// Runs stages.
pub trait Stages: Sync {
    /// The BTF.
    fn source(&self) -> &dyn BtfSource;

    /// Runs all units of a stage and calls `each` with every piece, from any thread and in any order unless the kernel
    /// states one. Returns the number of the stage. Advances `task` by the steps of the stage.
    ///
    /// # Errors
    /// As [`Kernel::run`].
    fn run(&self, stage: &Stage, task: &Task, each: Each) -> Result<usize>;

    /// What the units of a stage have kept is not needed any more.
    fn forget(&self, stage: usize);

    /// Gives a file that this process is writing a name by which all processes find it.
    ///
    /// # Errors
    /// [`Error::Io`].
    fn share(&self, path: &Path) -> Result<PathBuf> {
        Ok(path.into())
    }

    /// Whether this process computes everything itself.
    fn is_local(&self) -> bool {
        false
    }
}

/// Runs stages on the threads of this process.
pub struct Local<'a> {
    source: &'a dyn BtfSource,
    kept: Mutex<Vec<BTreeMap<usize, Arc<Vec<f32>>>>>,
}

impl<'a> Local<'a> {
    /// Stages of a source.
    pub fn new(source: &'a dyn BtfSource) -> Self {
        Self { source, kept: Mutex::default() }
    }
}

impl Stages for Local<'_> {
    fn source(&self) -> &dyn BtfSource {
        self.source
    }

    fn run(&self, stage: &Stage, task: &Task, each: Each) -> Result<usize> {
        let all = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let number = {
            let mut all = all();
            all.push(BTreeMap::new());
            all.len() - 1
        };
        let kept = |stage: usize, unit: usize| {
            let found = all().get(stage).and_then(|units| units.get(&unit).cloned());
            found.ok_or_else(|| Error::parameter("stage", format!("stage {stage} has kept nothing of unit {unit}")))
        };
        let site = Site { source: self.source, task, kept: &kept };
        stage.kernel.run(&site, &stage.known, 0..stage.units, &|unit, mut piece| {
            let keep = std::mem::take(&mut piece.kept);
            if !keep.is_empty() {
                all()[number].insert(unit, Arc::new(keep));
            }
            each(unit, piece)
        })?;
        Ok(number)
    }

    fn forget(&self, stage: usize) {
        if let Some(units) = self.kept.lock().unwrap_or_else(PoisonError::into_inner).get_mut(stage) {
            units.clear();
        }
    }

    fn is_local(&self) -> bool {
        true
    }
}

/// The program itself, stacks and small buffers, in bytes.
const PROGRAM: u64 = 40 << 20;

/// The largest number of threads up to `threads`, and of units up to those of `units` at a time, that stay within a memory limit.
///
/// # Errors
/// [`Error::Parameter`] if a single unit on one thread exceeds it.
fn within(
    memory: Memory,
    kernel: &dyn Kernel,
    meta: &BtfMeta,
    known: &Known,
    units: Range<usize>,
    threads: usize,
) -> Result<(usize, usize)> {
    let first = |count: usize| units.start..units.start + count;
    // what is known is read from a file
    let needed = |count: usize, threads: usize| {
        let of_kernel = kernel.memory(meta, known, first(count), threads);
        of_kernel.saturating_add(PROGRAM + 2 * known.bytes())
    };
    for threads in (1..=threads.max(1)).rev() {
        let mut count = units.len();
        while count > 1 && needed(count, threads) > memory.0 {
            count = count.div_ceil(2);
        }
        if needed(count, threads) <= memory.0 {
            return Ok((threads, count));
        }
    }
    let least = Memory(needed(1, 1).next_multiple_of(1 << 20));
    let problem = format!("found {memory}, expected at least {least} for one unit of the kernel {}", kernel.name());
    Err(Error::parameter("memory", problem))
}

/// Runs a stage and returns its pieces in the order of units.
///
/// # Errors
/// As [`Stages::run`].
pub fn collect(stages: &dyn Stages, stage: &Stage, task: &Task) -> Result<Vec<Piece>> {
    let pieces = Mutex::new(vec![Piece::default(); stage.units]);
    stages.run(stage, task, &|unit, piece| {
        pieces.lock().unwrap_or_else(PoisonError::into_inner)[unit] = piece;
        Ok(())
    })?;
    Ok(pieces.into_inner().unwrap_or_else(PoisonError::into_inner))
}
