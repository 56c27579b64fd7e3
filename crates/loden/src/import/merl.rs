//! `merl`: the `.binary` files of the MERL database.
//!
//! # Format
//! Three i32 (90, 90, 180: theta_h, theta_d, phi_d), then all red, all green, all blue values as f64. Ring k of theta_h
//! begins at k^2 / 90 degrees, the others are equally spaced to 90 and 180 degrees. A value times 1/1500, 1.15/1500
//! and 1.66/1500 is the BRDF in 1/sr. Other sizes of the same structure are read as well.
//!
//! # Limits
//! Values belong to cell centres and are interpolated between them. Many readers use a cell's value throughout the
//! cell and agree with this one at the centres only. Negative values mark missing measurements.
//!
//! # References
//! matusik2003

use std::f32::consts::{FRAC_PI_2, PI};
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::{Importer, Measured, head, located};
use crate::input::{Cursor, map};
use crate::material::{HalfTable, Notes, Period, Tabulated};
use crate::params::Values;
use crate::{Error, Result};

/// Factor from stored numbers to 1/sr.
pub(crate) const SCALE: [f64; 3] = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0];

pub(super) struct Merl;

impl Importer for Merl {
    fn name(&self) -> &'static str {
        "merl"
    }

    fn doc(&self) -> &'static str {
        "`.binary` files of the MERL database (half and difference angles)."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 12)?;
        let Some(dims) = dims(&bytes) else { return Ok(false) };
        // accept truncated files: the reader describes them better
        let usual = dims == [90, 90, 180];
        Ok(usual || std::fs::metadata(path).map_err(Error::io(path))?.len() == expected(dims))
    }

    fn open(&self, path: &Path, _options: &Values) -> Result<Measured> {
        let map = map(path)?;
        let mut cursor = Cursor::new(path, &map);
        let dims = dims(cursor.take("dims", 12)?)
            .ok_or_else(|| Error::invalid(path, "dims", "found a size out of range, expected 1 to 4096"))?;
        if map.len() as u64 != expected(dims) {
            let problem = format!("found {} bytes, expected {} for {dims:?} cells", map.len(), expected(dims));
            return Err(Error::invalid(path, "size", problem));
        }
        let cells = dims.iter().product::<usize>();
        let (numbers, _) = map[12..].as_chunks::<8>();
        let mut notes = Notes::default();
        let mut missing = 0;
        let value = |i: usize| {
            let channels = [0, 1, 2].map(|c| f64::from_le_bytes(numbers[c * cells + i]) * SCALE[c]);
            let measured = channels.iter().all(|v| v.is_finite() && *v >= 0.0);
            missing += usize::from(!measured);
            if measured { Vec3::from(channels.map(|v| v as f32)) } else { Vec3::NAN }
        };
        let values = (0..cells).map(value).collect();
        notes.fact("kind_of_surface", "isotropic");
        notes.fact("channels", "rgb");
        notes.fact("units", "1/sr, without a cosine; stored numbers times 1/1500, 1.15/1500 and 1.66/1500");
        notes.fact("cells", format!("{} theta_h x {} theta_d x {} phi_d", dims[0], dims[1], dims[2]));
        notes.fact("missing", missing);
        let table = HalfTable::new(middles(dims), Period::Half, values).map_err(located(path))?;
        Ok(Measured::Brdf(Arc::new(Tabulated::new(table, notes))))
    }
}

fn dims(bytes: &[u8]) -> Option<[usize; 3]> {
    let (numbers, _) = bytes.get(..12)?.as_chunks::<4>();
    let dims = [0, 1, 2].map(|i| i32::from_le_bytes(numbers[i]));
    dims.iter().all(|d| (1..=4096).contains(d)).then(|| dims.map(|d| d as usize))
}

fn expected(dims: [usize; 3]) -> u64 {
    12 + 24 * dims.iter().map(|&d| d as u64).product::<u64>()
}

/// The angles at the middles of the cells: theta_h, theta_d, phi_d.
pub(crate) fn middles([nh, nd, np]: [usize; 3]) -> [Vec<f32>; 3] {
    let at = |i: usize, n: usize| (i as f32 + 0.5) / n as f32;
    [
        (0..nh).map(|i| at(i, nh).powi(2) * FRAC_PI_2).collect(),
        (0..nd).map(|i| at(i, nd) * FRAC_PI_2).collect(),
        (0..np).map(|i| at(i, np) * PI).collect(),
    ]
}
