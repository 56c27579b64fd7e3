//! `ubo2003`: the archives of the Bonn goniometer, zip or unpacked folder.
//!
//! # Format
//! One JPEG or PNG per pair of directions, rectified, all of one size. The base name holds four numbers in
//! degrees, found by their keys: `00008 tl015 pl060 tv030 pv030.jpg` is light (15, 60), view (30, 30). Folders
//! and the running number carry no information. Directions are taken as the archive has them; the 81 of the
//! Bonn goniometer are put into its order, any others are sorted by polar angle, then azimuth.
//!
//! # Limits
//! The files state neither encoding, nor whether the light's cosine is in them, nor the sense of the azimuth:
//! by default sRGB, included and counter-clockwise. Missing pairs are reported and repeat the nearest measured
//! light of the same view. 8 bits per channel; grey images are read as RGB.
//!
//! # References
//! sattler2003

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use super::{Azimuth, Importer, Measured, Options, head, unstated};
use crate::btf::{BtfMeta, BtfSource, Cosine, SampleType, Texels};
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::{Error, Result};

mod files;
mod name;

use files::Files;
use name::Pair;

/// Rows and columns beyond this are refused before anything is allocated.
const MAX_SIDE: usize = 1 << 14;

pub(super) struct Ubo2003;

impl Importer for Ubo2003 {
    fn name(&self) -> &'static str {
        "ubo2003"
    }

    fn doc(&self) -> &'static str {
        "Zip or folder of JPEG or PNG images named by four angles (`tl015 pl060 tv030 pv030`), as of the Bonn goniometer."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        Ok(path.is_dir() || head(path, 4)?.starts_with(b"PK"))
    }

    fn open(&self, path: &Path, options: &Options) -> Result<Measured> {
        Ok(Measured::Btf(Arc::new(Archive::open(path, options)?)))
    }
}

/// An opened archive: images are decoded when asked for.
struct Archive {
    meta: BtfMeta,
    files: Files,
    /// Index into `files` for each (view, light); missing pairs repeat another.
    image: Vec<usize>,
    missing: Vec<(usize, usize)>,
    warnings: Vec<String>,
    facts: Vec<(&'static str, String)>,
}

impl Archive {
    fn open(path: &Path, options: &Options) -> Result<Self> {
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
        let missing: Vec<_> =
            (0..image.len()).filter(|&i| image[i].is_none()).map(|i| (i / lights.len(), i % lights.len())).collect();
        let (image, warnings) = fill(&files, image, &missing, &views, &lights);
        let [width, height, _] = decode(&files, 0, None)?.1;
        let meta = BtfMeta {
            width,
            height,
            views,
            lights,
            encoding: options.encoding.unwrap_or(Encoding::Srgb),
            cosine: options.cosine.unwrap_or(Cosine::Included),
            sample_type: SampleType::U8,
        };
        let stated = "not stated by the files; pictures of the Bonn goniometer are plain photographs";
        let mut facts = unstated(options, "not stated by the files; 8-bit pictures usually are sRGB", stated);
        facts.push(("why_azimuth", "the sense is not stated by the files; --azimuth chooses".into()));
        Ok(Self { meta, files, image, missing, warnings, facts })
    }

    fn decode_into(&self, view: usize, light: usize, out: &mut [u8]) -> Result<()> {
        let file = self.image[view * self.meta.lights.len() + light];
        let expected = Some([self.meta.width, self.meta.height]);
        let (pixels, [.., channels]) = decode(&self.files, file, expected)?;
        match channels {
            3 => out.copy_from_slice(&pixels),
            _ => out.chunks_exact_mut(3).zip(&pixels).for_each(|(rgb, &grey)| rgb.fill(grey)),
        }
        Ok(())
    }
}

impl BtfSource for Archive {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        let mut texels = vec![0; self.meta.view_len()];
        for (light, out) in texels.chunks_exact_mut(self.meta.image_len()).enumerate() {
            self.decode_into(view, light, out)?;
        }
        Ok(Texels::U8(Cow::Owned(texels)))
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        let mut texels = vec![0; self.meta.image_len()];
        self.decode_into(view, light, &mut texels)?;
        Ok(Texels::U8(Cow::Owned(texels)))
    }

    fn source_bytes(&self) -> u64 {
        self.files.bytes()
    }

    fn missing(&self) -> &[(usize, usize)] {
        &self.missing
    }

    fn facts(&self) -> &[(&'static str, String)] {
        &self.facts
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
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
        return Err(Error::invalid(files.path(), "content", "no JPEG or PNG image in it"));
    }
    Ok(pairs)
}

fn mirrored([theta, phi]: [f64; 2]) -> [f64; 2] {
    [theta, (360.0 - phi) % 360.0]
}

/// A hashable form of a direction: a thousandth of a degree, the azimuth wrapped and ignored at the pole.
fn key([theta, phi]: [f64; 2]) -> [i64; 2] {
    let thousandths = |degrees: f64| (degrees * 1000.0).round() as i64;
    let theta = thousandths(theta);
    [theta, if theta == 0 { 0 } else { thousandths(phi.rem_euclid(360.0)) % 360_000 }]
}

fn index_of(set: &DirectionSet) -> HashMap<[i64; 2], usize> {
    set.degrees().iter().enumerate().map(|(i, &d)| (key(d), i)).collect()
}

/// The distinct directions: a known set in its own order, else sorted.
fn directions(path: &Path, all: impl Iterator<Item = [f64; 2]>) -> Result<DirectionSet> {
    let mut distinct: Vec<[f64; 2]> = all.map(key).map(|k| k.map(|thousandths| thousandths as f64 / 1000.0)).collect();
    distinct.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    distinct.dedup();
    DirectionSet::from_degrees(distinct).map_err(|e| Error::invalid(path, "directions", e.to_string()))
}

/// Gives missing pairs the image of the nearest measured light of the same view (else of the nearest view).
fn fill(
    files: &Files,
    image: Vec<Option<usize>>,
    missing: &[(usize, usize)],
    views: &DirectionSet,
    lights: &DirectionSet,
) -> (Vec<usize>, Vec<String>) {
    let substitute = |view: usize, light: usize| {
        let row = &image[view * lights.len()..][..lights.len()];
        let nearness = |l: usize| lights.directions()[l].dot(lights.directions()[light]);
        // every view was named by at least one image
        (0..lights.len())
            .filter(|&l| row[l].is_some())
            .max_by(|&a, &b| nearness(a).total_cmp(&nearness(b)))
            .and_then(|l| row[l])
    };
    let filled =
        (0..image.len()).map(|i| image[i].or_else(|| substitute(i / lights.len(), i % lights.len())).unwrap_or(0));
    let mut warnings = files.warnings().to_vec();
    if let Some(&(view, light)) = missing.first() {
        let ([tl, pl], [tv, pv]) = (lights.degrees()[light], views.degrees()[view]);
        warnings.push(format!(
            "{} of {} pairs are missing, the first is tl{tl:03} pl{pl:03} tv{tv:03} pv{pv:03}; each repeats the nearest light of its view",
            missing.len(),
            image.len()
        ));
    }
    (filled.collect(), warnings)
}

/// Decodes one file to interleaved bytes and [width, height, channels], channels being 1 or 3.
fn decode(files: &Files, index: usize, expected: Option<[usize; 2]>) -> Result<(Vec<u8>, [usize; 3])> {
    let bytes = files.read(index)?;
    let wrong = |problem: String| Error::invalid(files.path(), files.name(index), problem);
    let (pixels, size) = if bytes.starts_with(b"\x89PNG") { png(&bytes) } else { jpeg(&bytes) }.map_err(wrong)?;
    let [width, height, _] = size;
    match expected {
        Some([w, h]) if [w, h] != [width, height] => {
            Err(wrong(format!("{width} x {height} texels, the other images have {w} x {h}")))
        }
        _ => Ok((pixels, size)),
    }
}

type Decoded = (Vec<u8>, [usize; 3]);

fn jpeg(bytes: &[u8]) -> std::result::Result<Decoded, String> {
    use zune_core::bytestream::ZCursor;
    use zune_core::colorspace::ColorSpace;
    use zune_core::options::DecoderOptions;
    let options = DecoderOptions::default()
        .set_max_width(MAX_SIDE)
        .set_max_height(MAX_SIDE)
        .set_strict_mode(true)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = zune_jpeg::JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let pixels = decoder.decode().map_err(|e| format!("not a whole JPEG image: {e:?}"))?;
    let info = decoder.info().ok_or("a JPEG image without a header")?;
    let (width, height) = (usize::from(info.width), usize::from(info.height));
    let channels = pixels.len() / (width * height).max(1);
    if ![1, 3].contains(&channels) || pixels.len() != width * height * channels {
        return Err(format!("{channels} channels, 1 or 3 expected"));
    }
    Ok((pixels, [width, height, channels]))
}

fn png(bytes: &[u8]) -> std::result::Result<Decoded, String> {
    let mut reader = image::ImageReader::with_format(std::io::Cursor::new(bytes), image::ImageFormat::Png);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_SIDE as u32);
    limits.max_image_height = Some(MAX_SIDE as u32);
    reader.limits(limits);
    let image = reader.decode().map_err(|e| format!("not a whole PNG image: {e}"))?;
    if image.color().bytes_per_pixel() != image.color().channel_count() {
        return Err("more than 8 bits per channel are not supported here".into());
    }
    let (width, height) = (image.width() as usize, image.height() as usize);
    Ok((image.into_rgb8().into_raw(), [width, height, 3]))
}
