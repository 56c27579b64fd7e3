//! Compressed forms of a material.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::btf::BtfSource;
use crate::codec::{self, Codec, Finish, Goal};
use crate::output;
use crate::params::{Given, Values};
use crate::progress::Progress;
use crate::{Error, Result};

/// A compressed form and what it cost.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Form {
    /// Relative to the material's folder.
    pub file: PathBuf,
    /// The codec.
    pub method: String,
    /// Its parameters: `name=value`, with spaces between; see [`Form::values`].
    pub params: String,
    /// Size of the file.
    pub bytes: u64,
    /// Error against the original, see [`crate::metric::Report`].
    pub mean_abs_error: f64,
    /// The largest absolute difference.
    pub max_abs_error: f64,
    /// Peak signal-to-noise ratio, dB.
    pub psnr_db: f64,
    /// Structural similarity.
    pub ssim: f64,
}

impl Form {
    /// The parameters of the codec.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the codec or a parameter is unknown.
    pub fn values(&self) -> Result<Values> {
        let given = self.params.split(' ').filter_map(|word| word.split_once('='));
        Values::new(codec::by_name(&self.method)?.params(), given)
    }
}

/// A compressed form to be made.
pub(super) struct Wanted {
    codec: &'static dyn Codec,
    /// The parameters that were asked for.
    given: Given,
    values: Values,
}

impl Wanted {
    /// A form for each of the methods, with those of the parameters that it has.
    pub(super) fn all(methods: &[String], params: &Given) -> Result<Vec<Self>> {
        let mut unknown = params.clone();
        let one = |method: &String| {
            let codec = codec::by_name(method)?;
            let given = params.split(codec.params()).0;
            unknown = unknown.split(codec.params()).1;
            Ok(Self { codec, values: given.values(codec.params())?, given })
        };
        let wanted = methods.iter().map(one).collect::<Result<_>>()?;
        match unknown.iter().next() {
            Some((name, _)) => Err(Error::parameter(name, "none of the methods has this parameter")),
            None => Ok(wanted),
        }
    }

    /// The path in the folder of its material: named after the method and the given parameters.
    pub(super) fn file(&self) -> PathBuf {
        let words = self.given.iter().map(|(name, text)| format!("-{name}-{text}")).collect::<String>();
        let plain = |c: char| if c.is_ascii_alphanumeric() || ".-".contains(c) { c } else { '_' };
        let words: String = words.chars().map(plain).collect();
        Path::new("compressed").join(format!("{}{words}.loden", self.codec.name()))
    }

    pub(super) fn compress(&self, source: &dyn BtfSource, folder: &Path, progress: &dyn Progress) -> Result<Form> {
        output::create_folder(folder.join("compressed"))?;
        let file = self.file();
        let finish = Finish { measure: true, ..Finish::default() };
        let path = folder.join(&file);
        let outcome = codec::compress(self.codec, source, &self.values, Goal::Params, finish, &path, progress)?;
        outcome.warnings.iter().for_each(|warning| progress.warn(warning));
        let report = outcome.error.ok_or_else(|| Error::parameter("method", "no error was measured"))?;
        Ok(Form {
            file,
            method: self.codec.name().into(),
            params: outcome.params.iter().map(|(name, text)| format!("{name}={text}")).collect::<Vec<_>>().join(" "),
            bytes: outcome.bytes,
            mean_abs_error: report.mean_abs_error,
            max_abs_error: report.max_abs_error,
            psnr_db: report.psnr_db,
            ssim: report.ssim,
        })
    }
}
