//! `mit`: the anisotropic BRDFs of MIT CSAIL (Ngan, Durand, Matusik).
//!
//! # Format
//! 16 i32: sizes of theta_in, theta_out, phi_diff, phi_in; `[6]` = 1 names this parametrisation; `[7]` = 0 means
//! equal bins; `[9]` = 1 means that phi_diff = phi_out - phi_in covers only 0 to 180 degrees; `[10]` is the number of
//! channels. Then f32, plane by plane (R, G, B), phi_in fastest. Negative numbers mark missing measurements.
//!
//! # Limits
//! Values belong to the centres of their bins and are assumed to be in 1/sr: the files do not state a scale. Where
//! phi_diff covers half a turn, the other half is its mirror image. The whole table is kept in memory.
//!
//! # References
//! ngan2005

use std::f32::consts::FRAC_PI_2;
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::{Importer, Measured, head, located};
use crate::input::{Cursor, map};
use crate::material::{Azimuths, InOutTable, Notes, Tabulated};
use crate::params::Values;
use crate::{Error, Result};

pub(super) struct Mit;

impl Importer for Mit {
    fn name(&self) -> &'static str {
        "mit"
    }

    fn doc(&self) -> &'static str {
        "Anisotropic BRDF tables of MIT CSAIL."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 64)?;
        let Some(header) = Header::read(&bytes) else { return Ok(false) };
        Ok(std::fs::metadata(path).map_err(Error::io(path))?.len() == header.file_len())
    }

    fn open(&self, path: &Path, _options: &Values) -> Result<Measured> {
        let map = map(path)?;
        let mut cursor = Cursor::new(path, &map);
        let header = Header::read(cursor.take("header", 64)?)
            .ok_or_else(|| Error::invalid(path, "header", "expected equal bins in the standard parametrisation"))?;
        if map.len() as u64 != header.file_len() {
            let problem = format!("found {} bytes, expected {}", map.len(), header.file_len());
            return Err(Error::invalid(path, "size", problem));
        }
        // Rearrange to the order of the table, mirroring phi_diff if necessary
        let (numbers, _) = map[64..].as_chunks::<4>();
        let [nti, nto, npd, npi] = header.dims;
        let plane = nti * nto * npd * npi;
        let full = if header.half { 2 * npd } else { npd };
        let mut missing = 0;
        let mut values = Vec::with_capacity(nti * npi * nto * full);
        for ti in 0..nti {
            for pi in 0..npi {
                for (to, pd) in (0..nto).flat_map(|to| (0..full).map(move |pd| (to, pd))) {
                    let pd = if pd < npd { pd } else { full - 1 - pd };
                    let at = ((ti * nto + to) * npd + pd) * npi + pi;
                    let value = Vec3::from([0, 1, 2].map(|c| f32::from_le_bytes(numbers[c * plane + at])));
                    let measured = value.is_finite() && value.min_element() >= 0.0;
                    missing += usize::from(!measured);
                    values.push(if measured { value } else { Vec3::NAN });
                }
            }
        }
        // Describe the file
        let mut notes = Notes::default();
        notes.fact("kind_of_surface", "anisotropic");
        notes.fact("channels", "rgb");
        notes.fact("units", "assumed to be 1/sr without a cosine; the file does not state its scale");
        notes.fact("bins", format!("{nti} theta_in x {nto} theta_out x {npd} phi_diff x {npi} phi_in"));
        notes.fact("missing", missing);
        let middles = |n: usize| (0..n).map(|i| (i as f32 + 0.5) / n as f32 * FRAC_PI_2).collect();
        let azimuths = Azimuths { light: npi, view: full, first: 0.5, view_is_relative: true };
        let table = InOutTable::new(middles(nti), middles(nto), azimuths, values).map_err(located(path))?;
        Ok(Measured::Brdf(Arc::new(Tabulated::new(table, notes))))
    }
}

struct Header {
    /// theta_in, theta_out, phi_diff, phi_in
    dims: [usize; 4],
    half: bool,
}

impl Header {
    fn read(bytes: &[u8]) -> Option<Self> {
        let (numbers, _) = bytes.get(..64)?.as_chunks::<4>();
        let number = |i: usize| i32::from_le_bytes(numbers[i]);
        let dims = [0, 1, 2, 3].map(number);
        let standard = number(6) == 1 && number(7) == 0 && number(10) == 3 && (0..=1).contains(&number(9));
        let sane = dims.iter().all(|d| (1..=1024).contains(d));
        (standard && sane).then(|| Self { dims: dims.map(|d| d as usize), half: number(9) == 1 })
    }

    fn file_len(&self) -> u64 {
        64 + 12 * self.dims.iter().map(|&d| d as u64).product::<u64>()
    }
}
