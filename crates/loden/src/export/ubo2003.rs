//! `ubo2003`: the layout of the Bonn archives, zip or folder, one picture per pair.
//!
//! # Format
//! `UBO2003/MANYFILES/tv030_pv090/00008 tl015 pl060 tv030 pv090.jpg`: light, then view, in degrees; the number
//! counts the lights of the view. Pictures are sRGB (EXR: linear, half precision) and always contain the light's cosine.

use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use super::{BtfWriter, Exporter, check_complete, check_view, substitutes};
use crate::btf::{BtfMeta, BtfSource, Cosine, FloatType, Texels};
use crate::color::Encoding;
use crate::output::{OutputDir, OutputFile, failed};
use crate::params::{Param, Params, Values};
use crate::picture::Picture;
use crate::{Error, Result};

pub(super) struct Ubo2003;

crate::params! {
    struct Pictures {
        /// Lossless PNG pictures instead of JPEG.
        png: bool,
        /// EXR pictures, linear light in half precision, instead of JPEG.
        exr: bool,
        /// Quality of JPEG pictures; chroma is not subsampled.
        quality: u8 [1..=100] = 95,
    }
}

impl Pictures {
    fn format(&self) -> Result<ImageFormat> {
        match (self.png, self.exr) {
            (true, true) => Err(Error::parameter("exr", "found both PNG and EXR, expected one format")),
            (true, false) => Ok(ImageFormat::Png),
            (false, true) => Ok(ImageFormat::ExrHalf),
            (false, false) => Ok(ImageFormat::Jpeg(self.quality)),
        }
    }
}

/// How pictures are stored.
#[derive(Debug, Clone, Copy)]
enum ImageFormat {
    /// JPEG of this quality.
    Jpeg(u8),
    Png,
    ExrHalf,
}

impl Exporter for Ubo2003 {
    fn name(&self) -> &'static str {
        "ubo2003"
    }

    fn doc(&self) -> &'static str {
        "`NAME.zip` or a folder of sRGB pictures in the layout of the Bonn archives; JPEG, PNG or EXR."
    }

    fn ending(&self) -> Option<&'static str> {
        Some("zip")
    }

    fn accepts(&self, path: &Path) -> bool {
        path.extension().is_none_or(|e| e == "zip") || path.is_dir()
    }

    fn params(&self) -> &'static [Param] {
        Pictures::TABLE
    }

    fn losses(&self, source: &dyn BtfSource) -> Vec<&'static str> {
        substitutes(source)
            .into_iter()
            .chain(["steps finer than those of the picture format, and values above 1 except in EXR"])
            .collect()
    }

    fn create(&self, path: &Path, meta: &BtfMeta, options: &Values) -> Result<Box<dyn BtfWriter>> {
        meta.check_grid("an archive or folder of pictures (a .toml file does not)")?;
        let image = Pictures::from_values(options)?.format()?;
        let is_zip = path.extension().is_some_and(|e| e == "zip") && !path.is_dir();
        let place = if is_zip {
            let output = OutputFile::create(path)?;
            let file = output.file().try_clone().map_err(Error::io(path))?;
            Place::Zip(Box::new(ZipWriter::new(Quiet { file: BufWriter::new(file), place: 0, failed: false })), output)
        } else {
            Place::Folder(OutputDir::create(path)?)
        };
        if meta.width.max(meta.height) > usize::from(u16::MAX) {
            return Err(Error::unsupported(path, "pictures of more than 65535 texels per side cannot be stored"));
        }
        let writer = Writer { place, path: path.into(), meta: meta.clone(), image, next: 0 };
        writer.check_names()?;
        Ok(Box::new(writer))
    }
}

enum Place {
    Zip(Box<ZipWriter<Quiet>>, OutputFile),
    Folder(OutputDir),
}

/// A file that reports its first failure only. What is written afterwards is lost: an archive that is dropped writes its
/// directory, and would print that this failed, too.
struct Quiet {
    file: BufWriter<File>,
    /// Where the next byte goes, or would go.
    place: u64,
    failed: bool,
}

impl Quiet {
    /// The result of an operation that leads to `place`; after a failure nothing is reported.
    fn report<T>(&mut self, result: std::io::Result<T>, lost: T, place: u64) -> std::io::Result<T> {
        if self.failed {
            self.place = place;
            return Ok(lost);
        }
        self.failed = result.is_err();
        if !self.failed {
            self.place = place;
        }
        result
    }
}

impl Write for Quiet {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let written = if self.failed { Ok(bytes.len()) } else { self.file.write(bytes) };
        let count = *written.as_ref().unwrap_or(&0) as u64;
        self.report(written, bytes.len(), self.place + count)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        let flushed = self.file.flush();
        self.report(flushed, (), self.place)
    }
}

impl Seek for Quiet {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let place = match to {
            SeekFrom::Start(place) => place,
            SeekFrom::Current(steps) => self.place.saturating_add_signed(steps),
            SeekFrom::End(_) => self.place,
        };
        let found = if self.failed { Ok(place) } else { self.file.seek(to) };
        let at = *found.as_ref().unwrap_or(&place);
        self.report(found, place, at)
    }
}

struct Writer {
    place: Place,
    path: PathBuf,
    meta: BtfMeta,
    image: ImageFormat,
    next: usize,
}

impl BtfWriter for Writer {
    fn view(&mut self, texels: &Texels<'_>) -> Result<()> {
        let (view, len) = (self.next, self.meta.image_len());
        check_view(&self.meta, self.next, texels)?;
        self.next += 1;
        let picture = |light: usize| {
            let image = texels.part(light * len..(light + 1) * len);
            let encoded = match self.image {
                ImageFormat::ExrHalf => to_exr(&image, &self.meta, light),
                format => encode(&to_srgb8(&image, &self.meta, light), &self.meta, format),
            };
            encoded.map_err(|problem| Error::invalid(&self.path, self.name(view, light), problem))
        };
        let pictures: Vec<Vec<u8>> = (0..self.meta.lights.len()).into_par_iter().map(picture).collect::<Result<_>>()?;
        for (light, bytes) in pictures.iter().enumerate() {
            let name = self.name(view, light);
            match &mut self.place {
                Place::Zip(zip, _) => append(zip, &name, bytes).map_err(failed(&self.path))?,
                Place::Folder(folder) => {
                    let file = folder.folder().join(&name);
                    let parent = file.parent().unwrap_or(folder.folder());
                    fs::create_dir_all(parent).and_then(|()| fs::write(&file, bytes)).map_err(failed(&self.path))?;
                }
            }
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        check_complete(&self.meta, self.next)?;
        match self.place {
            Place::Folder(folder) => folder.commit(),
            Place::Zip(zip, output) => {
                let mut file = zip.finish().map_err(|e| failed(&self.path)(e.into()))?;
                file.flush().map_err(failed(&self.path))?;
                output.commit()
            }
        }
    }
}

impl Writer {
    /// Views of one name would overwrite each other; the number keeps lights apart, but not for readers.
    fn check_names(&self) -> Result<()> {
        for (what, set) in [("views", &self.meta.views), ("lights", &self.meta.lights)] {
            let mut seen = HashMap::new();
            for (i, angles) in set.degrees().iter().enumerate() {
                if let Some(before) = seen.insert(angles.map(degrees), i) {
                    let [t, p] = angles.map(degrees);
                    let problem = format!(
                        "{what} {before} and {i} have the same direction ({t}, {p}), so their pictures would have the same name"
                    );
                    return Err(Error::unsupported(&self.path, problem));
                }
            }
        }
        Ok(())
    }

    fn name(&self, view: usize, light: usize) -> String {
        let [tl, pl] = self.meta.lights.degrees()[light].map(degrees);
        let [tv, pv] = self.meta.views.degrees()[view].map(degrees);
        let extension = match self.image {
            ImageFormat::Jpeg(_) => "jpg",
            ImageFormat::Png => "png",
            ImageFormat::ExrHalf => "exr",
        };
        format!("UBO2003/MANYFILES/tv{tv}_pv{pv}/{light:05} tl{tl} pl{pl} tv{tv} pv{pv}.{extension}")
    }
}

/// An angle as three digits, with decimals only if necessary.
fn degrees(angle: f64) -> String {
    let rounded = (angle * 1000.0).round() / 1000.0;
    if rounded.fract() == 0.0 {
        format!("{rounded:03}")
    } else {
        format!("{:03}{}", rounded.trunc(), &format!("{:.3}", rounded.fract())[1..])
    }
}

fn append(zip: &mut ZipWriter<Quiet>, name: &str, bytes: &[u8]) -> std::io::Result<()> {
    // pictures are already compressed; a fixed date makes the archive reproducible
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(DateTime::default());
    zip.start_file(name, options)?;
    zip.write_all(bytes)
}

/// One image as sRGB bytes including the cosine, rounded and clamped.
fn to_srgb8(texels: &Texels<'_>, meta: &BtfMeta, light: usize) -> Vec<u8> {
    let as_is = meta.encoding == Encoding::Srgb && meta.cosine == Cosine::Included;
    let cosine = match meta.cosine {
        Cosine::Included => 1.0,
        Cosine::Excluded => meta.lights.directions()[light].z,
    };
    let quantise = |&value: &f32| {
        let srgb = if as_is { value } else { Encoding::Srgb.encode(meta.encoding.decode(value) * cosine) };
        (srgb.clamp(0.0, 1.0) * 255.0).round() as u8
    };
    match texels {
        Texels::U8(bytes) if as_is => bytes.to_vec(),
        // only 256 values to convert
        Texels::U8(bytes) => {
            let table: Vec<u8> = (0..=255u8).map(|v| quantise(&(f32::from(v) / 255.0))).collect();
            bytes.iter().map(|&v| table[usize::from(v)]).collect()
        }
        _ => texels.to_f32().iter().map(quantise).collect(),
    }
}

/// One image in linear light including the cosine.
fn to_exr(texels: &Texels<'_>, meta: &BtfMeta, light: usize) -> std::result::Result<Vec<u8>, String> {
    let cosine = match meta.cosine {
        Cosine::Included => 1.0,
        Cosine::Excluded => meta.lights.directions()[light].z,
    };
    let values: Vec<f32> = texels.to_f32().iter().map(|&v| meta.encoding.decode(v) * cosine).collect();
    let rgb = values.chunks_exact(3).map(glam::Vec3::from_slice).collect();
    Picture { width: meta.width, height: meta.height, rgb }.to_exr(FloatType::F16)
}

fn encode(rgb: &[u8], meta: &BtfMeta, format: ImageFormat) -> std::result::Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    match format {
        ImageFormat::Jpeg(quality) => {
            let mut encoder = jpeg_encoder::Encoder::new(&mut bytes, quality);
            encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::R_4_4_4);
            encoder
                .encode(rgb, meta.width as u16, meta.height as u16, jpeg_encoder::ColorType::Rgb)
                .map_err(|e| e.to_string())?;
        }
        // EXR holds no 8-bit values
        ImageFormat::Png | ImageFormat::ExrHalf => {
            use image::ImageEncoder;
            image::codecs::png::PngEncoder::new(&mut bytes)
                .write_image(rgb, meta.width as u32, meta.height as u32, image::ExtendedColorType::Rgb8)
                .map_err(|e| e.to_string())?;
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_three_digits_with_decimals_only_where_needed() {
        assert_eq!([0.0, 7.5, 23.5, 345.0, 0.1 + 0.2].map(degrees), ["000", "007.500", "023.500", "345", "000.300"]);
    }
}
