//! Compression as a user asks for it: the error is measured and stored, and parameters may be searched for.

use std::path::Path;
use std::time::Instant;

use super::container::write_error;
use super::lossless::Stage;
use super::packed::pack;
use super::{Codec, EncodeSummary, Session, open};
use crate::btf::{BtfMeta, BtfSource};
use crate::metric::{self, Report};
use crate::output::OutputFile;
use crate::params::Values;
use crate::progress::Progress;
use crate::{Error, Result};

/// What compression aims at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Goal {
    /// The parameters as they are.
    Params,
    /// The smallest file whose mean error ([`Report::mean_abs_error`]) is at most this.
    MaxError(f64),
    /// The smallest error in at most as many bytes.
    Bytes(u64),
}

impl Goal {
    /// The mean error that a quality of 1..100 stands for: 0.1 at 1, 0.002 at 100, each step 3.9 % less.
    pub fn of_quality(quality: u8) -> Self {
        Self::MaxError(0.1 * 50f64.powf(-(f64::from(quality) - 1.0) / 99.0))
    }

    /// The logarithm of how far a trial is beyond the goal; at most 0 where the goal is met.
    fn excess(self, trial: &Outcome) -> f64 {
        match (self, &trial.error) {
            (Self::MaxError(most), Some(report)) => (report.mean_abs_error / most).ln(),
            (Self::Bytes(most), _) => (trial.bytes as f64 / most as f64).ln(),
            _ => 0.0,
        }
    }

    /// Below this excess a met goal is not worth a further trial.
    fn slack(self) -> f64 {
        match self {
            Self::MaxError(_) => -0.02,
            _ => -0.03,
        }
    }
}

/// What becomes of an encoded file.
#[derive(Debug, Clone, Copy, Default)]
pub struct Finish {
    /// Its error is measured and stored.
    pub measure: bool,
    /// Its numbers are packed.
    pub lossless: Option<&'static Stage>,
}

/// A file that was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Its size.
    pub bytes: u64,
    /// Sentences for the user to see.
    pub warnings: Vec<String>,
    /// The parameters it was made with.
    pub params: Values,
    /// How far its images are from the source, if that was measured.
    pub error: Option<Report>,
    /// Seconds it took to encode, with all trials.
    pub encode_s: f64,
    /// Seconds it took to measure.
    pub measure_s: f64,
    /// Files that were made to meet the goal.
    pub trials: usize,
}

/// Compresses `source` into the file `path`, packed or not, whose header holds the error if it is to be measured: that
/// takes a further pass over the source and decodes the file once. Without a goal the numbers are those of
/// [`Codec::encode`].
///
/// # Model
/// For a goal the codec's own way from small files to small errors is searched ([`Codec::dial`]) by the regula falsi on
/// logarithms of error or bytes; parameters that are given stay as they are. Each trial encodes the whole source, and
/// measures it if the goal is an error.
///
/// # Errors
/// As [`Codec::encode`]; [`Error::Parameter`] if the method has no dial, or nothing on its way meets the goal.
pub fn compress(
    codec: &dyn Codec,
    source: &dyn BtfSource,
    params: &Values,
    goal: Goal,
    finish: Finish,
    path: &Path,
    progress: &dyn Progress,
) -> Result<Outcome> {
    let Finish { measure, lossless } = finish;
    let mut job = Job { codec, source, session: codec.session(source), lossless, path, progress };
    let measure_trials = matches!(goal, Goal::MaxError(_));
    let (output, mut outcome) = match goal {
        Goal::Params => job.trial(params, false)?,
        _ => job.search(params, goal, measure_trials)?,
    };
    if measure && outcome.error.is_none() {
        job.measure(&output, &mut outcome)?;
    }
    if let Some(report) = outcome.error.filter(|_| measure) {
        write_error(output.temporary(), &report)?;
    }
    output.commit()?;
    Ok(outcome)
}

/// Trials of a search at most.
const TRIALS: usize = 12;

/// Ways shorter than this are not divided.
const CLOSE: f64 = 1.0 / 512.0;

struct Job<'a> {
    codec: &'a dyn Codec,
    source: &'a dyn BtfSource,
    session: Option<Box<dyn Session + 'a>>,
    lossless: Option<&'static Stage>,
    path: &'a Path,
    progress: &'a dyn Progress,
}

type Trial = (OutputFile, Outcome);

impl Job<'_> {
    fn trial(&mut self, params: &Values, measure: bool) -> Result<Trial> {
        let output = OutputFile::create(self.path)?;
        let start = Instant::now();
        let EncodeSummary { mut bytes, warnings } = match &mut self.session {
            Some(session) => session.encode(params, output.temporary(), self.progress)?,
            None => self.codec.encode(self.source, params, output.temporary(), self.progress)?,
        };
        if let Some(stage) = self.lossless {
            bytes = pack(output.temporary(), stage)?;
        }
        let encode_s = start.elapsed().as_secs_f64();
        let mut outcome =
            Outcome { bytes, warnings, params: params.clone(), error: None, encode_s, measure_s: 0.0, trials: 1 };
        if measure {
            self.measure(&output, &mut outcome)?;
        }
        Ok((output, outcome))
    }

    fn measure(&self, output: &OutputFile, outcome: &mut Outcome) -> Result<()> {
        let start = Instant::now();
        let decoded = open(output.temporary())?;
        outcome.error = Some(metric::compare(self.source, decoded.as_ref(), self.progress)?);
        outcome.measure_s += start.elapsed().as_secs_f64();
        Ok(())
    }

    fn search(&mut self, params: &Values, goal: Goal, measure: bool) -> Result<Trial> {
        let (codec, meta) = (self.codec, self.source.meta());
        let at = |place: f64| dialled(codec, meta, params, place);
        if at(0.0)? == at(1.0)? {
            let name = self.codec.name();
            return Err(Error::parameter("method", format!("{name} has nothing left to search: give its parameters")));
        }
        // from where the goal is met most easily to where it is met least
        let place = |way: f64| if measure { 1.0 - way } else { way };
        let (mut met, mut missed, mut best) = (None, None, None);
        let mut tried: Vec<Outcome> = Vec::new();
        let mut way = 0.5;
        loop {
            let values = at(place(way))?;
            // whole numbers: neighbouring places may be the same parameters
            let excess = if let Some(known) = tried.iter().find(|outcome| outcome.params == values) {
                goal.excess(known)
            } else {
                let (output, outcome) = self.trial(&values, measure)?;
                tried.push(outcome.clone());
                let excess = goal.excess(&outcome);
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
        let (output, outcome) = best.ok_or_else(|| unreachable(goal, tried.last()))?;
        let sum = |seconds: fn(&Outcome) -> f64| tried.iter().map(seconds).sum();
        let (encode_s, measure_s) = (sum(|o| o.encode_s), sum(|o| o.measure_s));
        Ok((output, Outcome { encode_s, measure_s, trials: tried.len(), ..outcome }))
    }
}

/// The parameters at a place of the dial; those that are given stay.
pub(super) fn dialled(codec: &dyn Codec, meta: &BtfMeta, params: &Values, place: f64) -> Result<Values> {
    let mut values = params.clone();
    for (name, text) in codec.dial(meta, place) {
        if !params.is_given(name) {
            values.set(name, &text)?;
        }
    }
    Ok(values)
}

/// Where to try next, between the last place that met the goal and the first that missed it.
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

/// From the last trial, which was that closest to the goal.
fn unreachable(goal: Goal, last: Option<&Outcome>) -> Error {
    match goal {
        Goal::Bytes(most) => {
            let least = last.map_or(0, |trial| trial.bytes);
            Error::parameter("bytes", format!("found {most}, but the smallest file has {least} bytes"))
        }
        _ => {
            let least = last.and_then(|trial| trial.error).map_or(f64::NAN, |report| report.mean_abs_error);
            Error::parameter("max-error", format!("the smallest error that this method reaches here is {least:.5}"))
        }
    }
}
