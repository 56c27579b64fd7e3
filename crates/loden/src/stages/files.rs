//! Stages whose units are run by other processes, which share a folder.
//!
//! # Model
//! A stage is a folder with what is known, and the number of tasks that its units are divided into. Any process may run any
//! task ([`run_task`]), more than once, because the result is the same: a file that appears when it is complete. The process
//! that runs the algorithm waits for all of them. It may also end and start again: it then finds the results of earlier stages
//! and comes to the same point.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufReader, BufWriter, Read, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::{Each, Kernel, Known, Piece, Site, Stage, Stages, within};
use crate::btf::BtfSource;
use crate::memory::Memory;
use crate::output::{self, OutputFile, failed};
use crate::progress::{Progress, Task};
use crate::{Error, Result};

/// A stage whose tasks are to be run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Waiting {
    /// The number of the stage.
    pub stage: usize,
    /// Its kernel.
    pub kernel: String,
    /// Number of its tasks.
    pub tasks: usize,
    /// Those that have no result yet.
    pub missing: Vec<usize>,
}

/// The file that describes a stage.
#[derive(Debug, Serialize, Deserialize)]
struct Header {
    kernel: String,
    units: usize,
    tasks: usize,
    steps: u64,
    settings: String,
}

impl Header {
    /// The units of a task.
    fn units(&self, task: usize) -> Range<usize> {
        task * self.units / self.tasks..(task + 1) * self.units / self.tasks
    }
}

/// Runs stages by files in a folder.
pub struct Folder<'a> {
    folder: PathBuf,
    source: &'a dyn BtfSource,
    tasks: usize,
    keep: bool,
    wait: Wait<'a>,
    next: AtomicUsize,
}

/// Waits until a stage has no task without a result.
pub type Wait<'a> = &'a (dyn Fn(&Waiting) -> Result<()> + Sync);

impl<'a> Folder<'a> {
    /// Stages in an existing folder, each divided into at most `tasks` tasks. Results are kept for another run if `keep`.
    pub fn new(
        folder: impl Into<PathBuf>,
        source: &'a dyn BtfSource,
        tasks: usize,
        keep: bool,
        wait: Wait<'a>,
    ) -> Self {
        Self { folder: folder.into(), source, tasks: tasks.max(1), keep, wait, next: AtomicUsize::new(0) }
    }

    /// Writes the description of a stage unless it is there.
    fn describe(&self, number: usize, stage: &Stage) -> Result<Header> {
        let folder = stage_folder(&self.folder, number);
        let header = Header {
            kernel: stage.kernel.name().into(),
            units: stage.units,
            tasks: self.tasks.min(stage.units).max(1),
            steps: stage.steps,
            settings: stage.known.settings.clone(),
        };
        if !folder.join(HEADER).exists() {
            output::create_folder(&folder)?;
            write_known(&folder.join(KNOWN), &stage.known)?;
            let text = super::settings(&header)?;
            output::write_file(folder.join(HEADER), |file| file.write_all(text.as_bytes()))?;
        }
        Ok(header)
    }
}

const HEADER: &str = "stage.json";
const KNOWN: &str = "known.safetensors";

fn stage_folder(folder: &Path, stage: usize) -> PathBuf {
    folder.join(format!("stage-{stage:03}"))
}

fn result_file(folder: &Path, task: usize) -> PathBuf {
    folder.join(format!("task-{task:05}"))
}

fn kept_file(folder: &Path, unit: usize) -> PathBuf {
    folder.join(format!("kept-{unit:05}"))
}

impl Stages for Folder<'_> {
    fn source(&self) -> &dyn BtfSource {
        self.source
    }

    fn run(&self, stage: &Stage, task: &Task, each: Each) -> Result<usize> {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        let header = self.describe(number, stage)?;
        let folder = stage_folder(&self.folder, number);
        let missing = || (0..header.tasks).filter(|&task| !result_file(&folder, task).exists()).collect::<Vec<_>>();
        let waiting = |missing| Waiting { stage: number, kernel: header.kernel.clone(), tasks: header.tasks, missing };
        if !missing().is_empty() {
            (self.wait)(&waiting(missing()))?;
        }
        if let Some(left) = missing().first() {
            return Err(Error::parameter("task", format!("task {left} of stage {number} has no result")));
        }
        for i in 0..header.tasks {
            let path = result_file(&folder, i);
            for (unit, piece) in read_pieces(&path, header.units(i))? {
                each(unit, piece)?;
            }
            if !self.keep {
                fs::remove_file(&path).map_err(Error::io(&path))?;
            }
            let (done, before) = (i as u64 + 1, i as u64);
            task.advance(header.steps * done / header.tasks as u64 - header.steps * before / header.tasks as u64)?;
        }
        if !self.keep {
            let known = folder.join(KNOWN);
            fs::remove_file(&known).map_err(Error::io(&known))?;
        }
        Ok(number)
    }

    fn forget(&self, stage: usize) {
        let Ok(entries) = fs::read_dir(stage_folder(&self.folder, stage)) else { return };
        for entry in entries.flatten().filter(|entry| entry.file_name().to_string_lossy().starts_with("kept-")) {
            // what stays is removed with the folder
            let _ = fs::remove_file(entry.path());
        }
    }

    fn share(&self, path: &Path) -> Result<PathBuf> {
        let shared = self.folder.join(format!("file-{:03}", self.next.load(Ordering::Relaxed)));
        let _ = fs::remove_file(&shared);
        if fs::hard_link(path, &shared).is_err() {
            fs::copy(path, &shared).map_err(failed(&shared))?;
        }
        Ok(shared)
    }
}

/// The number of tasks of a stage.
///
/// # Errors
/// [`Error::Io`] if there is no such stage.
pub fn tasks(folder: &Path, stage: usize) -> Result<usize> {
    Ok(read_header(&stage_folder(folder, stage))?.tasks)
}

/// Runs a task of a stage and writes its result into the folder, unless it is there. Units are run in as small groups and on as
/// few threads as the memory limit asks for.
///
/// # Errors
/// As [`Kernel::run`]; [`Error::Parameter`] if there is no such task, or a single unit exceeds the memory limit; [`Error::Io`].
pub fn run_task(
    folder: &Path,
    [stage, task]: [usize; 2],
    source: &dyn BtfSource,
    kernel: impl FnOnce(&str) -> Result<&'static dyn Kernel>,
    memory: Option<Memory>,
    progress: &dyn Progress,
) -> Result<()> {
    let of_stage = stage_folder(folder, stage);
    let header = read_header(&of_stage)?;
    if task >= header.tasks {
        return Err(Error::parameter("task", format!("found {task}, expected less than {}", header.tasks)));
    }
    let result = result_file(&of_stage, task);
    if result.exists() {
        return Ok(());
    }
    let kernel = kernel(&header.kernel)?;
    let known = read_known(&of_stage.join(KNOWN), &header)?;
    let units = header.units(task);
    let threads = rayon::current_num_threads();
    let (threads, count) = match memory {
        Some(memory) => within(memory, kernel, source.meta(), &known, units.clone(), threads)?,
        None => (threads, units.len()),
    };
    let steps = header.steps * units.len() as u64 / header.units.max(1) as u64;
    let running = Task::new(progress, kernel.name(), steps);
    let kept = |stage: usize, unit: usize| read_kept(&kept_file(&stage_folder(folder, stage), unit)).map(Arc::new);
    let site = Site { source, task: &running, kept: &kept };
    let output = OutputFile::create(&result)?;
    let writer = Mutex::new(BufWriter::new(output.file()));
    let work = || -> Result<()> {
        let starts = (units.start..units.end).step_by(count.max(1));
        for range in starts.map(|start| start..(start + count).min(units.end)) {
            kernel.run(&site, &known, range, &|unit, piece| {
                if !piece.kept.is_empty() {
                    let numbers: &[u8] = bytemuck::cast_slice(&piece.kept);
                    output::write_file(kept_file(&of_stage, unit), |file| file.write_all(numbers))?;
                }
                let mut writer = writer.lock().unwrap_or_else(PoisonError::into_inner);
                write_piece(&mut *writer, unit, &piece).map_err(failed(&result))
            })?;
        }
        Ok(())
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|e| Error::parameter("threads", e.to_string()))?.install(work)?;
    writer.into_inner().unwrap_or_else(PoisonError::into_inner).flush().map_err(failed(&result))?;
    output.commit()
}

fn read_header(folder: &Path) -> Result<Header> {
    let path = folder.join(HEADER);
    let text = fs::read_to_string(&path).map_err(Error::io(&path))?;
    serde_json::from_str(&text).map_err(|e| Error::invalid(&path, "stage", e.to_string()))
}

fn write_known(path: &Path, known: &Known) -> Result<()> {
    let mut tensors = BTreeMap::new();
    let invalid = |e: safetensors::SafeTensorError| Error::invalid(path, "tensors", e.to_string());
    for (i, values) in known.doubles.iter().enumerate() {
        let view = TensorView::new(Dtype::F64, vec![values.len()], bytemuck::cast_slice(values)).map_err(invalid)?;
        tensors.insert(format!("double.{i}"), view);
    }
    for (i, values) in known.floats.iter().enumerate() {
        let view = TensorView::new(Dtype::F32, vec![values.len()], bytemuck::cast_slice(values)).map_err(invalid)?;
        tensors.insert(format!("float.{i}"), view);
    }
    for (i, values) in known.indices.iter().enumerate() {
        let view = TensorView::new(Dtype::U32, vec![values.len()], bytemuck::cast_slice(values)).map_err(invalid)?;
        tensors.insert(format!("index.{i}"), view);
    }
    let bytes = safetensors::serialize(tensors, None).map_err(invalid)?;
    output::write_file(path, |file| file.write_all(&bytes))
}

fn read_known(path: &Path, header: &Header) -> Result<Known<'static>> {
    let bytes = fs::read(path).map_err(Error::io(path))?;
    let invalid = |e: safetensors::SafeTensorError| Error::invalid(path, "tensors", e.to_string());
    let tensors = SafeTensors::deserialize(&bytes).map_err(invalid)?;
    let mut known = Known { settings: header.settings.clone(), ..Known::default() };
    let all = |kind: &str| (0..).map_while(|i| tensors.tensor(&format!("{kind}.{i}")).ok()).collect::<Vec<_>>();
    known.doubles.extend(all("double").iter().map(|t| bytemuck::pod_collect_to_vec::<u8, f64>(t.data()).into()));
    known.floats.extend(all("float").iter().map(|t| bytemuck::pod_collect_to_vec::<u8, f32>(t.data()).into()));
    known.indices.extend(all("index").iter().map(|t| bytemuck::pod_collect_to_vec::<u8, u32>(t.data()).into()));
    Ok(known)
}

fn read_kept(path: &Path) -> Result<Vec<f32>> {
    let mut file = File::open(path).map_err(Error::io(path))?;
    let bytes = file.metadata().map_err(Error::io(path))?.len();
    let mut numbers = vec![0.0f32; bytes as usize / size_of::<f32>()];
    file.read_exact(bytemuck::cast_slice_mut(&mut numbers)).map_err(Error::io(path))?;
    Ok(numbers)
}

/// A piece: the unit, the number of doubles and of floats, and these.
fn write_piece(writer: &mut impl Write, unit: usize, piece: &Piece) -> std::io::Result<()> {
    let head = [unit as u64, piece.doubles.len() as u64, piece.floats.len() as u64];
    writer.write_all(bytemuck::cast_slice(&head))?;
    writer.write_all(bytemuck::cast_slice(&piece.doubles))?;
    writer.write_all(bytemuck::cast_slice(&piece.floats))
}

/// The pieces of a result in the order of units, which must be `units`.
fn read_pieces(path: &Path, units: Range<usize>) -> Result<BTreeMap<usize, Piece>> {
    let file = File::open(path).map_err(Error::io(path))?;
    let mut left = file.metadata().map_err(Error::io(path))?.len();
    let mut reader = BufReader::new(file);
    let mut pieces = BTreeMap::new();
    while left > 0 {
        let mut head = [0u64; 3];
        reader.read_exact(bytemuck::cast_slice_mut(&mut head)).map_err(Error::io(path))?;
        let [unit, doubles, floats] = head;
        let bytes = doubles.saturating_mul(8).saturating_add(floats.saturating_mul(4)).saturating_add(24);
        left =
            left.checked_sub(bytes).ok_or_else(|| Error::invalid(path, "piece", format!("unit {unit} is cut off")))?;
        let mut piece =
            Piece { doubles: vec![0.0; doubles as usize], floats: vec![0.0; floats as usize], kept: Vec::new() };
        reader.read_exact(bytemuck::cast_slice_mut(&mut piece.doubles)).map_err(Error::io(path))?;
        reader.read_exact(bytemuck::cast_slice_mut(&mut piece.floats)).map_err(Error::io(path))?;
        pieces.insert(unit as usize, piece);
    }
    if !pieces.keys().copied().eq(units.clone()) {
        return Err(Error::invalid(
            path,
            "unit",
            format!("found {} pieces, expected those of {units:?}", pieces.len()),
        ));
    }
    Ok(pieces)
}
