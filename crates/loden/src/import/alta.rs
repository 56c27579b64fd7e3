//! `alta`: data files of the ALTA library, text or binary.
//!
//! # Format
//! Lines `#KEY words`: `#DIM in out`, `#PARAM_IN`, `#PARAM_OUT`, `#VS` (columns of intervals, which are ignored); newer
//! files wrap them in `#ALTA_BEGIN_HEADER` and `#ALTA_END_HEADER`. Then follow lines of inputs and outputs, or with
//! `#FORMAT binary`, `#SAMPLE_COUNT` rows of f64 (or f32). Angles in radians.
//!
//! # Limits
//! Inputs: ISOTROPIC_TL_TV_PROJ_DPHI, ISOTROPIC_TV_TL_DPHI, SPHERICAL_TL_PL_TV_PV, RUSIN_TH_TD_PD and RUSIN_TH_TD
//! (phi_d at 90 degrees). Outputs: INV_STERADIAN and INV_STERADIAN_COSINE_FACTOR (the view's cosine is divided out),
//! one channel or three. An option states that azimuth differences are measured from the mirror side. Data are
//! assumed isotropic and reciprocal; negative values become 0.
//!
//! # References
//! belcour2013

use std::f32::consts::{FRAC_PI_2, PI};
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::rows::{MAX_TEXT, directions, number, scattered_facts};
use super::{Importer, Measured, head, located};
use crate::direction::{HalfDifference, from_angles};
use crate::input::{Cursor, map};
use crate::material::{BrdfSample, Notes, Scattered, Tabulated};
use crate::params::{Param, Params, Values};
use crate::{Error, Result};

pub(super) struct Alta;

crate::params! {
    struct Options {
        /// Measure azimuth differences from the mirror side instead of the light's side.
        phi_from_mirror: bool,
    }
}

impl Importer for Alta {
    fn name(&self) -> &'static str {
        "alta"
    }

    fn doc(&self) -> &'static str {
        "Text and binary data files of the ALTA library."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 4096)?;
        let text = String::from_utf8_lossy(&bytes);
        Ok(text.lines().map(str::trim_start).any(|l| l.starts_with("#DIM ") || l.starts_with("#ALTA_BEGIN_HEADER")))
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn open(&self, path: &Path, options: &Values) -> Result<Measured> {
        let options = Options::from_values(options)?;
        let map = map(path)?;
        if map.len() as u64 > MAX_TEXT {
            let (found, limit) = (map.len() as u64, MAX_TEXT);
            return Err(Error::Limit { path: path.into(), field: "size".into(), found, limit });
        }
        let header = Header::read(path, &map)?;
        let rows = if header.binary { header.binary_rows(path, &map)? } else { header.text_rows(path, &map)? };
        let mut notes = Notes::default();
        notes.fact("inputs", &header.inputs);
        notes.fact("outputs", &header.outputs);
        notes.fact("channels", if header.dim[1] == 3 { "rgb" } else { "one (grey)" });
        let (mut pairs, mut values, mut left_out) = (Vec::new(), Vec::new(), 0);
        for (line, row) in &rows {
            let (inputs, outputs) = row.split_at(header.dim[0]);
            let (wi, wo) = header.directions(path, *line, inputs, options.phi_from_mirror)?;
            if wi.z <= 0.0 || wo.z <= 0.0 {
                left_out += 1;
                continue;
            }
            let cosine = if header.outputs.ends_with("COSINE_FACTOR") { wo.z.max(1e-3) } else { 1.0 };
            pairs.push((wi, wo));
            (0..3).for_each(|channel| values.push(outputs[channel.min(outputs.len() - 1)] / cosine));
        }
        if left_out > 0 {
            notes.warnings.push(format!("{left_out} of {} rows are below the surface and were left out", rows.len()));
        }
        notes.clamp_negative(&mut values);
        let sample = |(&(wi, wo), v): (&(Vec3, Vec3), &[f32])| BrdfSample { wi, wo, value: Vec3::from_slice(v) };
        let samples = pairs.iter().zip(values.chunks_exact(3)).map(sample).collect();
        let table = Scattered::new(samples).map_err(located(path))?;
        scattered_facts(&mut notes, &table);
        Ok(Measured::Brdf(Arc::new(Tabulated::new(table, notes))))
    }
}

struct Header {
    /// Numbers of inputs and outputs.
    dim: [usize; 2],
    inputs: String,
    outputs: String,
    binary: bool,
    single: bool,
    count: usize,
    /// Bytes before a binary file's rows.
    bytes: usize,
}

type Row = (usize, Vec<f32>);

impl Header {
    fn read(path: &Path, bytes: &[u8]) -> Result<Self> {
        let mut header = Self {
            dim: [0, 0],
            inputs: "UNKNOWN".into(),
            outputs: "INV_STERADIAN".into(),
            binary: false,
            single: false,
            count: 0,
            bytes: 0,
        };
        let mut at = 0;
        for line in bytes.split_inclusive(|&b| b == b'\n') {
            at += line.len();
            let text = String::from_utf8_lossy(line);
            let mut words = text.split_whitespace();
            let whole = |word: Option<&str>| word.and_then(|w| w.parse::<usize>().ok()).unwrap_or(0);
            match words.next() {
                Some("#DIM") => header.dim = [whole(words.next()), whole(words.next())],
                Some("#PARAM_IN") => header.inputs = words.next().unwrap_or("").to_owned(),
                Some("#PARAM_OUT") => header.outputs = words.next().unwrap_or("").to_owned(),
                Some("#FORMAT") => header.binary = words.next() == Some("binary"),
                Some("#PRECISION") => header.single = words.next() == Some("ieee754-single"),
                Some("#SAMPLE_COUNT") => header.count = whole(words.next()),
                Some("#ENDIAN") if words.next() != Some("little") => {
                    return Err(Error::unsupported(path, "found a big-endian ALTA file, expected a little-endian one"));
                }
                Some("#ALTA_END_HEADER") => {
                    header.bytes = at;
                    break;
                }
                Some(word) if !word.starts_with('#') => break,
                _ => {}
            }
        }
        header.check(path)
    }

    fn check(self, path: &Path) -> Result<Self> {
        let expected = match self.inputs.as_str() {
            "ISOTROPIC_TL_TV_PROJ_DPHI" | "SPHERICAL_TL_PL_TV_PV" => 4,
            "ISOTROPIC_TV_TL_DPHI" | "RUSIN_TH_TD_PD" => 3,
            "RUSIN_TH_TD" => 2,
            other => {
                return Err(Error::unsupported(path, format!("#PARAM_IN {other} is not supported; see the reference")));
            }
        };
        // the projected form occurs both with and without the redundant azimuth difference
        let projected = self.inputs == "ISOTROPIC_TL_TV_PROJ_DPHI" && self.dim[0] == 3;
        if self.dim[0] != expected && !projected || ![1, 3].contains(&self.dim[1]) {
            return Err(Error::invalid(path, "#DIM", format!("found {:?}, expected [{expected}, 1 or 3]", self.dim)));
        }
        if !["INV_STERADIAN", "INV_STERADIAN_COSINE_FACTOR"].contains(&self.outputs.as_str()) {
            return Err(Error::unsupported(path, format!("#PARAM_OUT {} is not supported", self.outputs)));
        }
        Ok(self)
    }

    fn text_rows(&self, path: &Path, bytes: &[u8]) -> Result<Vec<Row>> {
        let text = String::from_utf8_lossy(bytes);
        let wanted = self.dim[0] + self.dim[1];
        let mut rows = Vec::new();
        for (content, line) in text.lines().zip(1..) {
            let content = content.split('#').next().unwrap_or("").trim();
            if content.is_empty() {
                continue;
            }
            let row: Vec<f32> =
                content.split_whitespace().take(wanted).map(|w| number(path, line, w)).collect::<Result<_>>()?;
            if row.len() < wanted {
                let problem = format!("found {} numbers, expected {wanted} as in #DIM", row.len());
                return Err(Error::invalid(path, format!("line {line}"), problem));
            }
            rows.push((line, row));
        }
        Ok(rows)
    }

    fn binary_rows(&self, path: &Path, bytes: &[u8]) -> Result<Vec<Row>> {
        let mut cursor = Cursor::new(path, &bytes[self.bytes..]);
        let columns = self.dim[0] + self.dim[1];
        let size = if self.single { 4 } else { 8 };
        if self.count as u64 > (cursor.left() / size / columns) as u64 {
            let problem = format!("found {} rows, which do not fit into {} bytes", self.count, cursor.left());
            return Err(Error::invalid(path, "#SAMPLE_COUNT", problem));
        }
        let mut one = |_| {
            let value = if self.single { cursor.f32("row")? } else { f64::from_le_bytes(cursor.array("row")?) as f32 };
            if value.is_finite() {
                Ok(value)
            } else {
                Err(Error::invalid(path, "row", "found a number that is not finite"))
            }
        };
        (0..self.count).map(|row| Ok((row + 1, (0..columns).map(&mut one).collect::<Result<_>>()?))).collect()
    }

    /// Light and view of a row.
    fn directions(&self, path: &Path, line: usize, inputs: &[f32], from_mirror: bool) -> Result<(Vec3, Vec3)> {
        let turn = if from_mirror { PI } else { 0.0 };
        match self.inputs.as_str() {
            "ISOTROPIC_TL_TV_PROJ_DPHI" => {
                let (theta_v, dphi) = (inputs[1].hypot(inputs[2]), inputs[2].atan2(inputs[1]));
                directions(path, line, [inputs[0], dphi + turn, theta_v, 0.0])
            }
            "ISOTROPIC_TV_TL_DPHI" => directions(path, line, [inputs[1], inputs[2] + turn, inputs[0], 0.0]),
            "SPHERICAL_TL_PL_TV_PV" => directions(path, line, [inputs[0], inputs[1] + turn, inputs[2], inputs[3]]),
            _ => {
                let phi_d = inputs.get(2).copied().unwrap_or(FRAC_PI_2);
                let wh = from_angles(inputs[0], 0.0);
                Ok(HalfDifference { wh, wd: from_angles(inputs[1], phi_d) }.directions())
            }
        }
    }
}
