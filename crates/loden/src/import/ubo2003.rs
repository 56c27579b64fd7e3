//! `ubo2003`: the archives of the Bonn goniometer, zip or unpacked folder.
//!
//! # Format
//! One rectified picture per pair of directions, all of one size: JPEG, PNG, TIFF, BMP, EXR, or Radiance HDR (ATRIUM). The
//! base name holds four numbers in degrees, found by their keys: `00008 tl015 pl060 tv030 pv030.jpg` is light (15,
//! 60), view (30, 30). Folders and the running number carry no information. The 81 directions of the Bonn goniometer
//! keep its order; other directions are sorted by polar angle, then azimuth.
//!
//! # Limits
//! The files state neither the encoding, nor whether the light's cosine is included, nor the sense of the azimuth.
//! The defaults are sRGB (linear for EXR and HDR), included, and counter-clockwise. Missing pairs are reported and
//! repeat the nearest measured light of the same view. Grey images are read as RGB. HDR files with the resolution `+X
//! 256 -Y 256` store the bottom row first, as other readers of these archives found.
//!
//! # References
//! sattler2003

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use super::image_set::{COMPLETE, Files as _, ImageSet, Plan};
use super::{Conventions, Importer, Measured, head, located};
use crate::btf::Cosine;
use crate::direction::DirectionSet;
use crate::params::{Param, Params, Values, YesNo};
use crate::{Error, Result};

mod files;
mod name;

use files::Files;
use name::Pair;

pub(super) struct Ubo2003;

crate::words! {
    /// Sense of azimuths, seen from above the sample.
    enum Azimuth {
        /// From +x (right) towards +y (up in the image).
        Counterclockwise = "ccw",
        /// From +x (right) towards -y (down in the image).
        Clockwise = "cw",
    }
}

crate::params! {
    struct Options {
        conventions: Conventions,
        /// Sense of the azimuths in file names, seen from above: counterclockwise or clockwise.
        azimuth: Azimuth = "ccw",
        complete: YesNo => COMPLETE,
    }
}

impl Importer for Ubo2003 {
    fn name(&self) -> &'static str {
        "ubo2003"
    }

    fn doc(&self) -> &'static str {
        "Zip or folder of pictures named by four angles (`tl015 pl060 tv030 pv030`), as from the Bonn goniometer."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        Ok(path.is_dir() || head(path, 4)?.starts_with(b"PK"))
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn open(&self, path: &Path, options: &Values) -> Result<Measured> {
        let options = Options::from_values(options)?;
        Ok(Measured::Btf(Arc::new(open_archive(path, &options)?)))
    }
}

/// Assigns files to pairs.
fn open_archive(path: &Path, options: &Options) -> Result<ImageSet<Files>> {
    let files = Files::list(path)?;
    let pairs = parse(&files, options.azimuth)?;
    let views = directions(path, pairs.iter().map(|p| p.view))?;
    let lights = directions(path, pairs.iter().map(|p| p.light))?;
    let mut image = vec![None; views.len() * lights.len()];
    let view_index = index_of(&views);
    let light_index = index_of(&lights);
    for (file, pair) in pairs.iter().enumerate() {
        let slot = &mut image[view_index[&key(pair.view)] * lights.len() + light_index[&key(pair.light)]];
        if let Some(other) = slot.replace(file) {
            let problem = format!("the same directions as {}", files.name(other));
            return Err(Error::invalid(path, files.name(file), problem));
        }
    }
    let stated = "not stated by the files; pictures from the Bonn goniometer are plain photographs";
    let encoding = "not stated by the files; 8-bit pictures are usually sRGB, HDR and EXR ones linear";
    let mut facts = options.conventions.reasons(encoding, stated);
    facts.push(("why_azimuth", "the sense is not stated by the files; set it by --azimuth".into()));
    let warnings = files.warnings().to_vec();
    let plan = Plan {
        views,
        lights,
        image,
        exposure: Vec::new(),
        turns: Vec::new(),
        cosine: Cosine::Included,
        warnings,
        facts,
    };
    let plan = plan.listed_unless(options.complete).map_err(located(path))?;
    ImageSet::new(files, plan, &options.conventions)
}

/// The directions of every image, in the order of `files`.
fn parse(files: &Files, azimuth: Azimuth) -> Result<Vec<Pair>> {
    let parse_one = |i: usize| {
        let pair =
            name::parse(files.name(i)).map_err(|problem| Error::invalid(files.path(), files.name(i), problem))?;
        Ok(match azimuth {
            Azimuth::Counterclockwise => pair,
            Azimuth::Clockwise => Pair { light: mirrored(pair.light), view: mirrored(pair.view) },
        })
    };
    let pairs: Vec<Pair> = (0..files.len()).map(parse_one).collect::<Result<_>>()?;
    if pairs.is_empty() {
        return Err(Error::invalid(files.path(), "content", "found no picture"));
    }
    Ok(pairs)
}

fn mirrored([theta, phi]: [f64; 2]) -> [f64; 2] {
    [theta, (360.0 - phi) % 360.0]
}

/// A hashable direction in thousandths of a degree; the azimuth is wrapped, and ignored at the pole.
fn key([theta, phi]: [f64; 2]) -> [i64; 2] {
    let thousandths = |degrees: f64| (degrees * 1000.0).round() as i64;
    let theta = thousandths(theta);
    [theta, if theta == 0 { 0 } else { thousandths(phi.rem_euclid(360.0)) % 360_000 }]
}

fn index_of(set: &DirectionSet) -> HashMap<[i64; 2], usize> {
    set.degrees().iter().enumerate().map(|(i, &d)| (key(d), i)).collect()
}

/// The distinct directions, in the order of a known set, otherwise sorted.
fn directions(path: &Path, all: impl Iterator<Item = [f64; 2]>) -> Result<DirectionSet> {
    let mut distinct: Vec<[f64; 2]> = all.map(key).map(|k| k.map(|thousandths| thousandths as f64 / 1000.0)).collect();
    distinct.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    distinct.dedup();
    DirectionSet::from_degrees(distinct).map_err(|e| Error::invalid(path, "directions", e.to_string()))
}
