//! The common header of all `.btf` files.

use std::path::Path;

use crate::color::spectrum::RgbWeights;
use crate::direction::DirectionSet;
use crate::import::located;
use crate::input::Cursor;
use crate::{Error, Result};

/// The kind of data after the directions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Dfmf,
    Fmf,
    /// FMF with an additional header.
    FmfExtended,
    Pvf,
    Bdi,
}

/// Longer signatures come first, so that the first match is the longest.
pub(crate) const SIGNATURES: &[(&[u8], Kind)] = &[
    (b"!BDIF06R2!", Kind::Bdi),
    (b"!FMF12FCE", Kind::FmfExtended),
    (b"!DFMF08FC", Kind::Dfmf),
    (b"!FMF06FC", Kind::Fmf),
    (b"!PVF06FC", Kind::Pvf),
];

/// Limit on views, lights and channels.
const MAX_COUNT: u32 = 1 << 16;

pub(super) struct Header {
    pub kind: Kind,
    /// Whether a block of rotations follows.
    pub rotated: bool,
    pub cosine: Option<u32>,
    pub channels: usize,
    /// Conversion to RGB, if the channels are not red, green and blue.
    pub weights: Option<RgbWeights>,
    pub views: DirectionSet,
    pub lights: DirectionSet,
    pub facts: Vec<(&'static str, String)>,
    pub warnings: Vec<String>,
}

impl Header {
    pub(super) fn read<'a>(path: &'a Path, bytes: &'a [u8]) -> Result<(Self, Cursor<'a>)> {
        // Read the signature
        let found = SIGNATURES.iter().find(|(signature, _)| bytes.starts_with(signature));
        let &(signature, kind) = found.ok_or_else(|| Error::invalid(path, "signature", "not a .btf file"))?;
        let mut cursor = Cursor::new(path, bytes);
        cursor.take("signature", signature.len() as u64)?;
        let rotated = kind != Kind::Bdi && bytes.get(signature.len()) == Some(&b'R');
        if rotated {
            cursor.u8("signature")?;
        }
        // Read the description of the measurement
        let start = cursor.at();
        let size = cursor.u32("struct_size")?;
        let version = cursor.u32("version")?;
        if !(1..=4).contains(&version) {
            return Err(Error::unsupported(
                path,
                format!("found version {version} of the .btf format, expected 1 to 4"),
            ));
        }
        let mut facts = vec![("version", version.to_string())];
        let mut warnings = Vec::new();
        for field in ["measurement_setup", "image_sensor", "light_source"] {
            facts.push((field, cursor.text(field, 80)?));
        }
        facts.push(("pixels_per_mm", cursor.f32("ppmm")?.to_string()));
        let scale = cursor.f32s::<3>("rgb_scale")?;
        if scale != [1.0; 3] {
            warnings.push(format!("rgb_scale is {scale:?}, which is not applied"));
        }
        let cosine = if version > 1 { Some(cursor.u32("cosine_flag")?) } else { None };
        if version > 2 {
            let length = cursor.u32("xml_len")?;
            cursor.take("xml", length.into())?;
        }
        let names = if version > 3 { channel_names(&mut cursor)? } else { ["R", "G", "B"].map(str::to_owned).to_vec() };
        if cursor.at() - start != size as usize {
            let problem = format!("found {size}, but the block has {} bytes", cursor.at() - start);
            return Err(cursor.invalid("struct_size", problem));
        }
        facts.push(("channels", names.join(" ")));
        // Read channels and directions
        let weights = spectral(path, &names)?;
        let [views, lights] = directions(path, &mut cursor)?;
        let header = Self { kind, rotated, cosine, channels: names.len(), weights, views, lights, facts, warnings };
        Ok((header, cursor))
    }

    /// Skips the local frames.
    pub(super) fn rotations(&self, cursor: &mut Cursor<'_>) -> Result<()> {
        if self.rotated {
            let count = cursor.u32("number of rotations")?;
            cursor.take("rotations", u64::from(count) * 36)?;
        }
        Ok(())
    }

    pub(super) fn pairs(&self) -> usize {
        self.views.len() * self.lights.len()
    }
}

fn channel_names(cursor: &mut Cursor<'_>) -> Result<Vec<String>> {
    let count = cursor.u32("channels")?;
    if count == 0 || count > MAX_COUNT {
        return Err(cursor.invalid("channels", format!("found {count}, expected 1 to {MAX_COUNT}")));
    }
    let name = |_| {
        let length = cursor.u32("length of a channel's name")?;
        cursor.text("name of a channel", length.into())
    };
    (0..count).map(name).collect()
}

/// Conversion of the channels to RGB, unless they are RGB already.
fn spectral(path: &Path, names: &[String]) -> Result<Option<RgbWeights>> {
    if names.len() == 3 {
        return Ok(None);
    }
    let nanometres = |name: &String| name.trim().trim_end_matches("nm").trim().parse::<f32>().ok();
    let wavelengths: Option<Vec<f32>> = names.iter().map(nanometres).collect();
    let wavelengths = wavelengths.ok_or_else(|| {
        let problem = format!("{} channels that are not wavelengths: {}", names.len(), names.join(" "));
        Error::invalid(path, "channels", problem)
    })?;
    RgbWeights::new(&wavelengths).map(Some).map_err(located(path))
}

fn directions(path: &Path, cursor: &mut Cursor<'_>) -> Result<[DirectionSet; 2]> {
    let count = cursor.u32("number of views")?;
    let mut views = Vec::new();
    let mut lights: Option<Vec<[f64; 2]>> = None;
    for view in 0..count {
        views.push(angles(cursor, "view")?);
        let count = cursor.u32("number of lights")?;
        let list: Vec<[f64; 2]> = (0..count).map(|_| angles(cursor, "light")).collect::<Result<_>>()?;
        if lights.as_ref().is_some_and(|lights| *lights != list) {
            return Err(Error::unsupported(path, format!("the lights of view {view} differ from those of view 0")));
        }
        lights = Some(list);
    }
    let (views, lights) = (DirectionSet::from_degrees(views), DirectionSet::from_degrees(lights.unwrap_or_default()));
    Ok([views.map_err(located(path))?, lights.map_err(located(path))?])
}

/// Polar angle and azimuth in degrees.
fn angles(cursor: &mut Cursor<'_>, field: &str) -> Result<[f64; 2]> {
    let [theta, phi] = cursor.f32s::<2>(field)?.map(|radians| f64::from(radians).to_degrees());
    // single precision has lost the last digits of the intended degrees
    let tidy = |degrees: f64| (degrees * 1e4).round() / 1e4;
    let theta = tidy(theta);
    if (0.0..=90.0).contains(&theta) {
        return Ok([theta, tidy(phi).rem_euclid(360.0)]);
    }
    Err(cursor.invalid(field, format!("found polar angle {theta}, expected 0 to 90 degrees")))
}

/// Width and height.
pub(super) fn size(cursor: &mut Cursor<'_>) -> Result<[usize; 2]> {
    let [width, height] = [cursor.u32("width")?, cursor.u32("height")?];
    if width == 0 || height == 0 || width > MAX_COUNT || height > MAX_COUNT {
        return Err(cursor.invalid("size", format!("found {width} x {height}, expected 1 to {MAX_COUNT}")));
    }
    Ok([width as usize, height as usize])
}
