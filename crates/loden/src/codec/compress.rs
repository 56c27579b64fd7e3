//! Compression with a goal: searches the parameters, measures the error and stores it in the file.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::container::write_error;
use super::lossless;
use super::packed::pack;
use super::{CODECS, Codec, EncodeInStages, EncodeSummary, Session, budget, open, suited};
use crate::btf::{BtfMeta, BtfSource};
use crate::metric::{self, Report};
use crate::output::OutputFile;
use crate::params::Values;
use crate::progress::{Progress, Shares, Task};
use crate::stages::{Each, Kernel, Known, Local, Piece, Site, Stage, Stages, collect, settings};
use crate::{Error, Result};

/// The goal of a compression.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// Use the given parameters.
    Params,
    /// The smallest file whose mean error ([`Report::mean_abs_error`]) does not exceed this.
    MaxError(f64),
    /// The smallest error in a file of at most this many bytes.
    Bytes(u64),
}

impl Goal {
    /// The mean error that a quality of 1..100 stands for: 0.1 at 1, 0.002 at 100, falling by 3.9 % per step.
    pub fn of_quality(quality: u8) -> Self {
        Self::MaxError(0.1 * 50f64.powf(-(f64::from(quality) - 1.0) / 99.0))
    }

    /// The logarithm of the ratio of a trial's error or size to the goal; not positive if the goal is met.
    fn excess(self, trial: &Outcome) -> f64 {
        match (self, &trial.error) {
            (Self::MaxError(most), Some(report)) => (report.mean_abs_error / most).ln(),
            (Self::Bytes(most), _) => (trial.bytes as f64 / most as f64).ln(),
            _ => 0.0,
        }
    }

    /// A trial that meets the goal this closely ends the search.
    fn slack(self) -> f64 {
        match self {
            Self::MaxError(_) => -0.02,
            _ => -0.03,
        }
    }
}

/// What to do with an encoded file.
#[derive(Debug, Clone, Copy, Default)]
pub struct Finish {
    /// Measure the error and store it.
    pub measure: bool,
    /// Pack the file with this lossless stage.
    pub lossless: Option<&'static lossless::Stage>,
}

/// A compressed file.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Its size in bytes.
    pub bytes: u64,
    /// Warnings for the user.
    pub warnings: Vec<String>,
    /// The parameters used: those given, lowered where they exceed what the BTF has a use for ([`suited`]).
    pub params: Values,
    /// The lossless stage that packed the file; `None` also if packing would have enlarged it.
    pub lossless: Option<&'static str>,
    /// The error of the decoded images, if it was measured.
    pub error: Option<Report>,
    /// Seconds spent encoding, over all trials.
    pub encode_s: f64,
    /// Seconds spent measuring.
    pub measure_s: f64,
    /// Number of files encoded to meet the goal.
    pub trials: usize,
}

/// Compresses `source` into the file `path`, optionally packed. If the error is to be measured, the source is read
/// once more, the file is decoded once, and the error is stored in its header. Without a goal the result equals that
/// of [`Codec::encode`].
///
/// # Model
/// With a goal, the regula falsi searches the codec's dial from small files to small errors ([`Codec::dial`]), on the
/// logarithm of the error or size. Parameters that the user gave stay fixed. Each trial encodes the whole source, and
/// measures the error if the goal is an error.
///
/// # Errors
/// As [`Codec::encode`]; [`Error::Parameter`] if the method has no dial, or no point of it meets the goal.
pub fn compress(
    codec: &dyn Codec,
    source: &dyn BtfSource,
    params: &Values,
    goal: Goal,
    finish: Finish,
    path: &Path,
    progress: &dyn Progress,
) -> Result<Outcome> {
    compress_in_stages(codec, &Local::new(source), params, goal, finish, path, progress)
}

/// As [`compress`], with the same bytes, but everything that reads the source is done by `stages`.
///
/// # Errors
/// As [`compress`]; [`Error::Parameter`] if the method has no stages.
pub fn compress_in_stages(
    codec: &dyn Codec,
    stages: &dyn Stages,
    params: &Values,
    goal: Goal,
    finish: Finish,
    path: &Path,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let Finish { measure, lossless } = finish;
    let session = if stages.is_local() { codec.session(stages.source()) } else { None };
    let mut job = Job { codec, stages, session, lossless, path };
    let measure_trials = matches!(goal, Goal::MaxError(_));
    let (output, mut outcome) = match goal {
        Goal::Params => job.trial(params, false, progress)?,
        _ => job.search(params, goal, measure_trials, progress)?,
    };
    if measure && outcome.error.is_none() {
        job.measure(&output, &mut outcome, progress)?;
    }
    if let Some(report) = outcome.error.filter(|_| measure) {
        write_error(output.temporary(), &report)?;
    }
    output.commit()?;
    Ok(outcome)
}

/// Maximum number of trials.
const TRIALS: usize = 12;

/// Intervals of the dial shorter than this are not divided further.
const CLOSE: f64 = 1.0 / 512.0;

struct Job<'a> {
    codec: &'a dyn Codec,
    stages: &'a dyn Stages,
    session: Option<Box<dyn Session + 'a>>,
    lossless: Option<&'static lossless::Stage>,
    path: &'a Path,
}

type Trial = (OutputFile, Outcome);

impl Job<'_> {
    fn trial(&mut self, params: &Values, measure: bool, progress: &dyn Progress) -> Result<Trial> {
        let (params, mut notes) = suited(self.codec, self.stages.source().meta(), params)?;
        let output = OutputFile::create(self.path)?;
        let start = Instant::now();
        let EncodeSummary { mut bytes, warnings } = match &mut self.session {
            Some(session) => session.encode(&params, output.temporary(), progress)?,
            None if self.stages.is_local() => {
                self.codec.encode(self.stages.source(), &params, output.temporary(), progress)?
            }
            None => {
                let encode = check_stages(self.codec)?;
                encode(self.stages, &params, output.temporary(), progress)?
            }
        };
        notes.extend(warnings);
        let mut lossless = None;
        if let Some(stage) = self.lossless {
            match pack(output.temporary(), stage)? {
                packed if packed < bytes => (bytes, lossless) = (packed, Some(stage.name)),
                packed => notes
                    .push(format!("{} would enlarge the file from {bytes} to {packed} bytes: not packed", stage.name)),
            }
        }
        let encode_s = start.elapsed().as_secs_f64();
        let mut outcome =
            Outcome { bytes, warnings: notes, params, lossless, error: None, encode_s, measure_s: 0.0, trials: 1 };
        if measure {
            self.measure(&output, &mut outcome, progress)?;
        }
        Ok((output, outcome))
    }

    fn measure(&self, output: &OutputFile, outcome: &mut Outcome, progress: &dyn Progress) -> Result<()> {
        let start = Instant::now();
        let meta = self.stages.source().meta();
        let path = self.stages.share(output.temporary())?;
        // an opened file is mapped, unpacked, or decoded to at most the numbers of its recipe
        let tensors = self.codec.recipe(meta, &outcome.params)?.tensors(meta);
        let held = tensors.iter().map(|tensor| tensor.bytes()).sum::<u64>() * 3 / 2;
        let known = Known { settings: settings(&Opened { path, held })?, ..Known::default() };
        let (units, steps) = (meta.views.len(), meta.pairs() as u64);
        let task = Task::new(progress, "compare", steps);
        let mut total = metric::Total::default();
        for piece in collect(self.stages, &Stage { kernel: &Differences, known, units, steps }, &task)? {
            total.add(piece.doubles.as_chunks::<4>().0);
        }
        outcome.error = Some(total.report(meta)?);
        outcome.measure_s += start.elapsed().as_secs_f64();
        Ok(())
    }

    fn search(&mut self, params: &Values, goal: Goal, measure: bool, progress: &dyn Progress) -> Result<Trial> {
        let (codec, meta) = (self.codec, self.stages.source().meta());
        let at = |place: f64| dialled(codec, meta, params, place);
        if at(0.0)? == at(1.0)? {
            let name = self.codec.name();
            return Err(Error::parameter("method", format!("{name} has nothing left to search: give its parameters")));
        }
        // begin at the end where the goal is easiest to meet
        let place = |way: f64| if measure { 1.0 - way } else { way };
        let (mut met, mut missed, mut best) = (None, None, None);
        let mut tried: Vec<(Values, Outcome)> = Vec::new();
        let mut way = 0.5;
        let trials = Shares::new(progress, "search", TRIALS);
        loop {
            let values = at(place(way))?;
            // neighbouring places can round to the same whole numbers
            let excess = if let Some((_, known)) = tried.iter().find(|(params, _)| *params == values) {
                goal.excess(known)
            } else {
                let share = trials.share();
                share.step(&format!("trial {}", tried.len() + 1));
                let (output, outcome) = self.trial(&values, measure, &share)?;
                let excess = goal.excess(&outcome);
                tried.push((values, outcome.clone()));
                if excess <= 0.0 {
                    best = Some((output, outcome));
                }
                excess
            };
            match excess <= 0.0 {
                true => met = Some((way, excess)),
                false if way == 0.0 => break,
                false => missed = Some((way, excess)),
            }
            let enough = met.is_some_and(|(way, excess)| excess >= goal.slack() || way == 1.0);
            match next(met, missed) {
                Some(next) if !enough && (tried.len() < TRIALS || met.is_none()) => way = next,
                _ => break,
            }
        }
        let (output, outcome) = best.ok_or_else(|| unreachable(goal, tried.last().map(|(_, outcome)| outcome)))?;
        let sum = |seconds: fn(&Outcome) -> f64| tried.iter().map(|(_, outcome)| seconds(outcome)).sum();
        let (encode_s, measure_s) = (sum(|o| o.encode_s), sum(|o| o.measure_s));
        Ok((output, Outcome { encode_s, measure_s, trials: tried.len(), ..outcome }))
    }
}

/// The parameters at a place of the dial. Parameters that the user gave keep their values.
pub(super) fn dialled(codec: &dyn Codec, meta: &BtfMeta, params: &Values, place: f64) -> Result<Values> {
    let mut values = params.clone();
    for (name, text) in codec.dial(meta, place) {
        if !params.is_given(name) {
            values.set(name, &text)?;
        }
    }
    Ok(values)
}

/// The next place to try, between the last that met the goal and the first that missed it.
fn next(met: Option<(f64, f64)>, missed: Option<(f64, f64)>) -> Option<f64> {
    match (met, missed) {
        (Some((a, _)), None) => Some(if a > 0.9 { 1.0 } else { 0.5 * (1.0 + a) }),
        (None, Some((b, _))) => Some(if b < 0.1 { 0.0 } else { 0.5 * b }),
        (Some((a, low)), Some((b, high))) if b - a > CLOSE => {
            let share = (-low / (high - low)).clamp(0.1, 0.9);
            Some(a + (b - a) * share)
        }
        _ => None,
    }
}

/// The error for a goal that cannot be met; `last` is the trial that came closest.
fn unreachable(goal: Goal, last: Option<&Outcome>) -> Error {
    match goal {
        Goal::Bytes(most) => {
            let least = last.map_or(0, |trial| trial.bytes);
            Error::parameter("bytes", format!("found {most}, but the smallest file has {least} bytes"))
        }
        _ => {
            let least = last.and_then(|trial| trial.error).map_or(f64::NAN, |report| report.mean_abs_error);
            Error::parameter("max-error", format!("the smallest error this method can reach here is {least:.5}"))
        }
    }
}

/// The stages of a method.
///
/// # Errors
/// [`Error::Parameter`] if it has none.
pub fn check_stages(codec: &dyn Codec) -> Result<EncodeInStages> {
    let names: Vec<_> = CODECS.iter().filter(|codec| codec.in_stages().is_some()).map(|codec| codec.name()).collect();
    let problem = format!("{} cannot be distributed; these methods can: {}", codec.name(), names.join(", "));
    codec.in_stages().ok_or_else(|| Error::parameter("method", problem))
}

/// Differences between the source and a file that was made of it: a unit is a view.
pub(super) struct Differences;

/// A file that was made of the source.
#[derive(Serialize, Deserialize)]
struct Opened {
    path: PathBuf,
    /// Upper bound of its memory in bytes.
    held: u64,
}

impl Kernel for Differences {
    fn name(&self) -> &'static str {
        "differences"
    }

    fn memory(&self, meta: &BtfMeta, known: &Known, _units: Range<usize>, threads: usize) -> u64 {
        let held = known.settings::<Opened>().map_or(u64::MAX / 2, |opened| opened.held);
        held + budget::source(meta, threads) + threads as u64 * budget::singles(6 * meta.image_len())
    }

    fn run(&self, site: &Site, known: &Known, units: Range<usize>, each: Each) -> Result<()> {
        let decoded = open(known.settings::<Opened>()?.path)?;
        for view in units {
            let sums = metric::view_sums(site.source, decoded.as_ref(), view, site.task)?;
            each(view, Piece { doubles: sums.as_flattened().to_vec(), ..Piece::default() })?;
        }
        Ok(())
    }
}
