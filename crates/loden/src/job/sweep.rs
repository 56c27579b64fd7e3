//! Sizes and errors of every method on one measurement.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::{Comparison, compare, shown_pairs};
use crate::btf::{BtfMeta, BtfSource};
use crate::codec::lossless::{Rate, rates};
use crate::codec::{self, Codec};
use crate::memory;
use crate::metric::{Detail, detail};
use crate::params::Values;
use crate::progress::Progress;
use crate::{Error, Result};

/// Settings with published figures, and those of a method without a quality dial; others use positions of their dial.
const PUBLISHED: &[(&str, &[&str])] = &[
    (
        "pvmf",
        &[
            "components=2",
            "components=4",
            "components=7",
            "components=9",
            "components=15",
            "components=17",
            "components=22",
            "components=30",
        ],
    ),
    ("pca", &["components=4", "components=16", "components=64"]),
    ("svd", &["components=4", "components=16", "components=64"]),
    (
        "median-cut",
        &[
            "clusters=64 split=longest-edge",
            "clusters=256 split=balanced",
            "clusters=256 split=longest-edge",
            "clusters=400 split=longest-edge",
        ],
    ),
    (
        "neural",
        &["features=4 width=32 samples=30", "features=8 width=48 samples=30", "features=16 width=64 samples=30"],
    ),
    ("analytic", &["model=lafortune", "model=lafortune lobes=2", "model=ggx"]),
];

/// Positions of a quality dial that are swept.
const PLACES: [f64; 4] = [0.3, 0.45, 0.6, 0.75];

/// Compression ratio that [`middling`] looks for.
const MIDDLING_RATIO: f64 = 100.0;

/// Parameters by name, as a user would write them.
pub type Setting = Vec<(&'static str, String)>;

/// Cost of one file, and the distribution of its errors.
#[derive(Debug, Clone, Serialize)]
pub struct SweepRow {
    /// Size and errors.
    #[serde(flatten)]
    pub row: Comparison,
    /// The setting as flags of the command line.
    pub flags: String,
    /// Bytes of the tables for evaluation.
    pub resident_bytes: u64,
    /// Distribution of the errors.
    pub detail: Detail,
    /// Sizes after general-purpose compression, for one file of each method.
    pub lossless: Vec<Rate>,
}

/// Cost of encoding.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Cost {
    /// Time in seconds.
    pub encode_s: f64,
    /// Peak resident memory.
    pub peak_rss_bytes: Option<u64>,
}

/// Why a setting has no row; a sentence each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Trouble {
    /// The setting does not suit the measurement.
    Unsuitable(String),
    /// Something else went wrong.
    Failed(String),
}

impl From<Error> for Trouble {
    fn from(error: Error) -> Self {
        match error {
            Error::Parameter { .. } => Self::Unsuitable(error.to_string()),
            other => Self::Failed(other.to_string()),
        }
    }
}

/// Encodes one setting into a file.
pub type Encode<'a> = dyn Fn(&'static dyn Codec, &Setting, &Path) -> std::result::Result<Cost, Trouble> + 'a;

/// The result of [`sweep`].
#[derive(Debug, Clone)]
pub struct Swept {
    /// A row for each setting that worked.
    pub rows: Vec<SweepRow>,
    /// The settings that failed, and the methods of which no setting suits the measurement.
    pub failed: Vec<String>,
}

/// Settings of a sweep.
pub struct Sweeping<'a> {
    /// The measurement.
    pub source: &'a dyn BtfSource,
    /// The methods.
    pub codecs: &'a [&'static dyn Codec],
    /// The folder for the compressed files.
    pub folder: &'a Path,
    /// How to encode: [`encode_here`], or in a process of its own, whose peak memory is the encoder's.
    pub encode: &'a Encode<'a>,
}

/// Compresses the measurement by every method at several settings, and compares each file with it. Settings
/// that do not suit the measurement are skipped with a warning; failures are warned of and listed.
///
/// # Errors
/// [`Error::Parameter`] if nothing could be compressed; errors of comparing; [`Error::Cancelled`].
pub fn sweep(job: &Sweeping, progress: &dyn Progress) -> Result<Swept> {
    let meta = job.source.meta();
    let (mut rows, mut failed) = (Vec::new(), Vec::new());
    for codec in job.codecs {
        let (before, failures) = (rows.len(), failed.len());
        for setting in sweep_settings(*codec, meta) {
            let name = format!("{} {}", codec.name(), flags(&setting));
            progress.stage(&name);
            match job.row(*codec, &setting, progress) {
                Ok(row) => rows.push(row),
                _ if progress.is_cancelled() => return Err(Error::Cancelled),
                Err(Trouble::Unsuitable(problem)) => progress.warn(&format!("{name}: {problem}")),
                Err(Trouble::Failed(problem)) => {
                    progress.warn(&format!("{name}: {problem}"));
                    failed.push(name);
                }
            }
        }
        if (rows.len(), failed.len()) == (before, failures) {
            failed.push(codec.name().into());
        }
    }
    if rows.is_empty() && !failed.iter().all(|name| codec::by_name(name).is_ok()) {
        return Err(Error::unsupported(job.folder, "nothing was written: every setting failed"));
    }
    if rows.is_empty() {
        return Err(Error::parameter("methods", "none of them could compress this measurement"));
    }
    for i in middling(&rows, meta) {
        rows[i].lossless = rates(codec::open(&rows[i].row.file)?.as_ref())?;
    }
    Ok(Swept { rows, failed })
}

impl Sweeping<'_> {
    fn row(
        &self,
        codec: &'static dyn Codec,
        setting: &Setting,
        progress: &dyn Progress,
    ) -> std::result::Result<SweepRow, Trouble> {
        let path = self.folder.join(file_name(codec, setting));
        let Cost { encode_s, peak_rss_bytes } = (self.encode)(codec, setting, &path)?;
        self.measure(&path, setting, progress)
            .map(|row| SweepRow { row: Comparison { encode_s: Some(encode_s), peak_rss_bytes, ..row.row }, ..row })
            .map_err(|error| Trouble::Failed(error.to_string()))
    }

    fn measure(&self, path: &Path, setting: &Setting, progress: &dyn Progress) -> Result<SweepRow> {
        let row = compare(self.source, path, false, progress)?;
        let compressed = codec::open(path)?;
        let seen = shown_pairs(self.source.meta());
        let detail = detail(self.source, compressed.as_ref(), &seen, progress)?;
        let resident_bytes = compressed.resident_bytes();
        Ok(SweepRow { row, flags: flags(setting), resident_bytes, detail, lossless: Vec::new() })
    }
}

/// Encodes in this process; the peak memory includes earlier allocations.
///
/// # Errors
/// As [`Codec::encode`].
pub fn encode_here(
    codec: &'static dyn Codec,
    source: &dyn BtfSource,
    setting: &Setting,
    path: &Path,
    progress: &dyn Progress,
) -> Result<Cost> {
    let (params, notes) = codec::suited(codec, source.meta(), &given(codec, setting)?)?;
    notes.iter().for_each(|note| progress.warn(note));
    memory::reset_peak();
    let start = Instant::now();
    codec.encode(source, &params, path, progress)?;
    Ok(Cost { encode_s: start.elapsed().as_secs_f64(), peak_rss_bytes: Some(memory::peak()) })
}

fn given(codec: &dyn Codec, setting: &Setting) -> Result<Values> {
    Values::new(codec.params(), setting.iter().map(|(name, text)| (*name, text.as_str())))
}

pub(super) fn file_name(codec: &dyn Codec, setting: &Setting) -> PathBuf {
    if setting.is_empty() {
        return format!("{}.loden", codec.name()).into();
    }
    let words: Vec<String> = setting.iter().map(|(name, text)| format!("{name}-{text}")).collect();
    format!("{}-{}.loden", codec.name(), words.join("-")).into()
}

pub(super) fn flags(setting: &Setting) -> String {
    setting.iter().map(|(name, text)| format!("--{name} {text}")).collect::<Vec<_>>().join(" ")
}

/// The settings at which a method is swept: those of published figures, or positions of its quality dial, lowered to
/// what the measurement has a use for. Settings that coincide for a small measurement appear once.
pub fn sweep_settings(codec: &dyn Codec, meta: &BtfMeta) -> Vec<Setting> {
    let published = |setting: &&'static str| {
        let pairs = setting.split(' ').filter_map(|word| word.split_once('='));
        pairs.map(|(name, text)| (name, text.to_owned())).collect()
    };
    let mut all: Vec<Setting> = match PUBLISHED.iter().find(|(name, _)| *name == codec.name()) {
        Some((_, settings)) => settings.iter().map(published).collect(),
        None => PLACES.iter().map(|&place| codec.dial(meta, place)).collect(),
    };
    for setting in &mut all {
        let suited = given(codec, setting).and_then(|params| codec::suited(codec, meta, &params));
        let Ok((params, _)) = suited else { continue };
        for (name, text) in setting {
            *text = params.written(name).map_or(text.clone(), str::to_owned);
        }
    }
    all.dedup();
    all
}

/// For each method, the index of the row whose file is closest to a hundredth of the raw data.
pub fn middling(rows: &[SweepRow], meta: &BtfMeta) -> Vec<usize> {
    let wanted = meta.raw8_bytes() as f64 / MIDDLING_RATIO;
    let far = |i: &usize| (rows[*i].row.bytes as f64 / wanted).ln().abs();
    let mut methods: Vec<&str> = rows.iter().map(|row| row.row.method.as_str()).collect();
    methods.dedup();
    let nearest = |method: &str| {
        let of_method = (0..rows.len()).filter(|&i| rows[i].row.method == method);
        of_method.min_by(|a, b| far(a).total_cmp(&far(b)))
    };
    methods.into_iter().filter_map(nearest).collect()
}
