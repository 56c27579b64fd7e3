//! `utia`: the anisotropic BRDFs of the UTIA database.
//!
//! # Format
//! A table of 288 x 288 values per channel. Rows are lights, columns views; each is 6 polar angles (0 to 75 degrees in
//! steps of 15) times 48 azimuths (steps of 7.5 degrees, varying fastest). `.bin` holds 3 planes of f64 (R, G, B)
//! without a header; `.exr` and `.png` are pictures of 288 x 288 pixels.
//!
//! # Limits
//! The absolute scale of the database is not stated: numbers are taken as 1/sr; PNG values are sRGB-encoded.
//! The values at 75 degrees extend to 90 degrees.
//!
//! # References
//! filip2014

use std::path::Path;
use std::sync::Arc;

use glam::Vec3;

use super::{Importer, Measured, head, located};
use crate::input::map;
use crate::material::{Azimuths, InOutTable, Notes, Tabulated};
use crate::params::Values;
use crate::picture::Picture;
use crate::{Error, Result};

const SIDE: usize = 288;
const THETAS: [f32; 6] = [0.0, 15.0, 30.0, 45.0, 60.0, 75.0];

pub(super) struct Utia;

impl Importer for Utia {
    fn name(&self) -> &'static str {
        "utia"
    }

    fn doc(&self) -> &'static str {
        "`.bin`, `.exr` and `.png` tables of the UTIA database (288 x 288 pairs of directions)."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        let bytes = head(path, 12)?;
        if is_picture(&bytes) {
            return Ok(Picture::dimensions(path)? == (SIDE, SIDE));
        }
        Ok(!path.is_dir() && std::fs::metadata(path).map_err(Error::io(path))?.len() == (SIDE * SIDE * 24) as u64)
    }

    fn open(&self, path: &Path, _options: &Values) -> Result<Measured> {
        let mut notes = Notes::default();
        let is_picture = is_picture(&head(path, 4)?);
        let mut values = if is_picture { Picture::read(path, &mut notes.warnings)?.rgb } else { plain(path)? };
        if let Some(i) = values.iter().position(|v| !v.is_finite()) {
            return Err(Error::invalid(
                path,
                format!("row {}, column {}", i / SIDE, i % SIDE),
                "found a number that is not finite",
            ));
        }
        notes.fact("kind_of_surface", "anisotropic");
        notes.fact("channels", "rgb");
        notes.fact("directions", "288 lights x 288 views");
        notes.fact("units", "taken as 1/sr without a cosine; the database does not state its scale");
        notes.clamp_negative(bytemuck::cast_slice_mut(&mut values));
        let thetas = THETAS.map(f32::to_radians).to_vec();
        let azimuths = Azimuths { light: 48, view: 48, first: 0.0, view_is_relative: false };
        let table = InOutTable::new(thetas.clone(), thetas, azimuths, values).map_err(located(path))?;
        Ok(Measured::Brdf(Arc::new(Tabulated::new(table, notes))))
    }
}

/// PNG or EXR.
fn is_picture(head: &[u8]) -> bool {
    head.starts_with(b"\x89PNG") || head.starts_with(&[0x76, 0x2f, 0x31, 0x01])
}

fn plain(path: &Path) -> Result<Vec<Vec3>> {
    let map = map(path)?;
    let (numbers, _) = map.as_chunks::<8>();
    if numbers.len() != 3 * SIDE * SIDE {
        return Err(Error::invalid(path, "size", format!("{} numbers, expected {}", numbers.len(), 3 * SIDE * SIDE)));
    }
    let channel = |c: usize, i: usize| f64::from_le_bytes(numbers[c * SIDE * SIDE + i]) as f32;
    Ok((0..SIDE * SIDE).map(|i| Vec3::new(channel(0, i), channel(1, i), channel(2, i))).collect())
}
