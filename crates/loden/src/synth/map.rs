//! Maps of sources as files, and applied to pictures.
//!
//! # Model
//! A map is a PNG of 16 bits whose red is the column and whose green is the row of the texel that is copied, or an EXR with the
//! integer channels `x` and `y`. Applied to a picture, it moves pixels without changing them: PNG of 8 or 16 bits with or
//! without alpha, EXR with any channels and layers. Pictures of other formats become PNG of 8 bits.
//!
//! # Limits
//! EXR files of mipmaps or of subsampled channels are refused.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, IntegerBounds, Layer, LayerAttributes, LineOrder,
    ReadChannels, ReadLayers, Vec2, WritableImage, read,
};
use image::codecs::png::PngEncoder;
use image::{DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat, ImageReader};

use super::{Source, SourceMap};
use crate::input::guarded;
use crate::output::write_file;
use crate::picture::decode::dwa;
use crate::picture::{MAX_PIXELS, Picture};
use crate::{Error, Result};

/// The layers of an EXR file.
type Layers = Image<exr::prelude::Layers<AnyChannels<FlatSamples>>>;

/// Channels of a map.
const NAMES: [&str; 2] = ["x", "y"];

/// Blocks in a fixed order, losslessly compressed.
fn lossless() -> Encoding {
    Encoding { line_order: LineOrder::Increasing, ..Encoding::SMALL_FAST_LOSSLESS }
}

/// Whether the name of an output ends in `.exr`, or else in `.png`.
///
/// # Errors
/// [`Error::Unsupported`] for another ending.
fn is_exr(path: &Path) -> Result<bool> {
    match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("exr") => Ok(true),
        Some("png") => Ok(false),
        _ => Err(Error::unsupported(path, "expected an image file ending in .png or .exr")),
    }
}

/// Writes a map as PNG or EXR, chosen by the extension.
///
/// # Errors
/// [`Error::Unsupported`] for another extension; [`Error::Io`].
pub fn write(map: &SourceMap, path: &Path) -> Result<()> {
    let mut file = Cursor::new(Vec::new());
    if is_exr(path)? {
        let channel = |k: usize| {
            let number = |source: &Source| u32::from([source.x, source.y][k]);
            AnyChannel::new(NAMES[k], FlatSamples::U32(map.sources.iter().map(number).collect()))
        };
        let channels = AnyChannels::sort([channel(0), channel(1)].into_iter().collect());
        let layer = Layer::new((map.width, map.height), LayerAttributes::default(), lossless(), channels);
        let written = Image::from_layer(layer).write().to_buffered(&mut file);
        written.map_err(|e| Error::invalid(path, "EXR", e.to_string()))?;
    } else {
        let bytes: Vec<u8> =
            map.sources.iter().flat_map(|source| [source.x, source.y, 0].map(u16::to_ne_bytes)).flatten().collect();
        let (width, height) = (map.width as u32, map.height as u32);
        image::write_buffer_with_format(&mut file, &bytes, width, height, ExtendedColorType::Rgb16, ImageFormat::Png)
            .map_err(|e| Error::invalid(path, "PNG", e.to_string()))?;
    }
    write_file(path, |out| out.write_all(file.get_ref()))
}

/// Reads a map that [`write()`] wrote.
///
/// # Errors
/// [`Error::Invalid`] if it is not a map; [`Error::Limit`]; [`Error::Io`].
pub fn read_map(path: &Path) -> Result<SourceMap> {
    let bytes = fs::read(path).map_err(Error::io(path))?;
    let invalid = |problem: String| Error::invalid(path, "map", problem);
    if !is_exr_file(&bytes) {
        let (picture, _) = read_png(path, &bytes)?;
        let DynamicImage::ImageRgb16(picture) = picture else {
            return Err(invalid(format!("found {:?}, expected RGB of 16 bits", picture.color())));
        };
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let sources = picture.as_raw().as_chunks::<3>().0.iter().map(|&[x, y, _]| Source { x, y }).collect();
        return Ok(SourceMap { width, height, sources });
    }
    let image = read_exr(path, &bytes)?;
    let layer = image.layer_data.first().ok_or_else(|| invalid("it has no layer".into()))?;
    let numbers = |name: &str| {
        let channel = layer.channel_data.list.iter().find(|channel| channel.name.eq(name));
        let channel = channel.ok_or_else(|| invalid(format!("there is no channel {name}")))?;
        match &channel.sample_data {
            FlatSamples::U32(numbers) if numbers.iter().all(|v| u16::try_from(*v).is_ok()) => Ok(numbers),
            _ => Err(invalid(format!("channel {name}: expected integers below 65536"))),
        }
    };
    let (columns, rows) = (numbers(NAMES[0])?, numbers(NAMES[1])?);
    let sources = columns.iter().zip(rows).map(|(&x, &y)| Source { x: x as u16, y: y as u16 }).collect();
    Ok(SourceMap { width: layer.size.width(), height: layer.size.height(), sources })
}

/// Rearranges the pixels of the picture `input`, whose depth is kept, and writes it as `output`.
///
/// # Errors
/// [`Error::Parameter`] if the map does not suit the size of the picture; [`Error::Unsupported`], [`Error::Invalid`],
/// [`Error::Limit`], [`Error::Io`].
pub fn apply(map: &SourceMap, input: &Path, output: &Path) -> Result<()> {
    let bytes = fs::read(input).map_err(Error::io(input))?;
    let wants_exr = is_exr(output)?;
    let is_png = bytes.starts_with(b"\x89PNG");
    if is_exr_file(&bytes) != wants_exr && (wants_exr || is_exr_file(&bytes)) {
        let kind = if wants_exr {
            "integers, which are written as .png"
        } else {
            "floating-point numbers, which are written as .exr"
        };
        return Err(Error::unsupported(input, format!("holds {kind}")));
    }
    let rearranged = if wants_exr {
        rearrange_exr(map, input, &bytes)?
    } else if is_png {
        rearrange_png(map, input, &bytes)?
    } else {
        let picture = Picture::read(input, &mut Vec::new())?;
        map.check(picture.width, picture.height)?;
        let rgb = map.sources.iter().map(|source| picture.rgb[source.texel(picture.width)]).collect();
        return Picture { width: map.width, height: map.height, rgb }.write(output);
    };
    write_file(output, |out| out.write_all(&rearranged))
}

fn is_exr_file(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01])
}

/// A PNG file and its colour profile.
fn read_png(path: &Path, bytes: &[u8]) -> Result<(DynamicImage, Option<Vec<u8>>)> {
    let failed = |problem: String| Error::invalid(path, "PNG", problem);
    let open = || ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png).into_decoder();
    let decode = || {
        let mut decoder = open()?;
        let profile = decoder.icc_profile()?;
        Ok((DynamicImage::from_decoder(decoder)?, profile))
    };
    let (width, height) = guarded("PNG", || open().map(|decoder| decoder.dimensions()))
        .map_err(failed)?
        .map_err(|e| failed(e.to_string()))?;
    check_pixels(path, u64::from(width) * u64::from(height))?;
    guarded("PNG", decode).map_err(failed)?.map_err(|e: image::ImageError| failed(e.to_string()))
}

fn check_pixels(path: &Path, found: u64) -> Result<()> {
    let limit = MAX_PIXELS as u64;
    if found <= limit { Ok(()) } else { Err(Error::Limit { path: path.into(), field: "pixels".into(), found, limit }) }
}

fn rearrange_png(map: &SourceMap, path: &Path, bytes: &[u8]) -> Result<Vec<u8>> {
    let (picture, profile) = read_png(path, bytes)?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    map.check(width, height)?;
    let (pixels, size) = (picture.as_bytes(), usize::from(picture.color().bytes_per_pixel()));
    let moved = map.sources.iter().flat_map(|source| &pixels[source.texel(width) * size..][..size]);
    let moved: Vec<u8> = moved.copied().collect();
    let mut file = Vec::new();
    let mut encoder = PngEncoder::new(&mut file);
    let failed = |e: image::ImageError| Error::invalid(path, "PNG", e.to_string());
    if let Some(profile) = profile {
        // an encoder without support for profiles would still write the pixels
        let _ = encoder.set_icc_profile(profile);
    }
    encoder.write_image(&moved, map.width as u32, map.height as u32, picture.color().into()).map_err(failed)?;
    Ok(file)
}

/// All layers of an EXR file.
fn read_exr(path: &Path, bytes: &[u8]) -> Result<Layers> {
    let failed = |problem: String| Error::invalid(path, "EXR", problem);
    let invalid = |e: exr::error::Error| failed(e.to_string());
    // check the headers before allocating pixels
    let headers = guarded("EXR", || MetaData::read_from_buffered(Cursor::new(bytes), false)).map_err(failed)?;
    let headers = headers.map_err(invalid)?.headers;
    let pixels =
        |header: &exr::meta::header::Header| header.layer_size.area() as u64 * header.channels.list.len().max(1) as u64;
    headers.iter().try_for_each(|header| check_pixels(path, pixels(header)))?;
    if headers.iter().flat_map(|header| &header.channels.list).any(|channel| channel.sampling != Vec2(1, 1)) {
        return Err(Error::unsupported(path, "has subsampled channels"));
    }
    guarded("EXR", || dwa::check(bytes, &headers)).map_err(failed)?.map_err(invalid)?;
    let image = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    // by this thread, as a panic of another could not be caught
    let image = image.non_parallel();
    guarded("EXR", || image.from_buffered(Cursor::new(bytes))).map_err(failed)?.map_err(invalid)
}

fn rearrange_exr(map: &SourceMap, path: &Path, bytes: &[u8]) -> Result<Vec<u8>> {
    let mut image = read_exr(path, bytes)?;
    let size = Vec2(map.width, map.height);
    for layer in &mut image.layer_data {
        let width = layer.size.width();
        map.check(width, layer.size.height())?;
        for channel in &mut layer.channel_data.list {
            channel.sample_data = moved(&channel.sample_data, map, width);
        }
        (layer.size, layer.encoding) = (size, lossless());
        layer.attributes.layer_position = Vec2(0, 0);
    }
    image.attributes.display_window = IntegerBounds::new(Vec2(0, 0), size);
    let mut file = Cursor::new(Vec::new());
    image.write().to_buffered(&mut file).map_err(|e| Error::invalid(path, "EXR", e.to_string()))?;
    Ok(file.into_inner())
}

fn moved(samples: &FlatSamples, map: &SourceMap, width: usize) -> FlatSamples {
    fn all<T: Copy>(samples: &[T], map: &SourceMap, width: usize) -> Vec<T> {
        map.sources.iter().map(|source| samples[source.texel(width)]).collect()
    }
    match samples {
        FlatSamples::F16(samples) => FlatSamples::F16(all(samples, map, width)),
        FlatSamples::F32(samples) => FlatSamples::F32(all(samples, map, width)),
        FlatSamples::U32(samples) => FlatSamples::U32(all(samples, map, width)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> SourceMap {
        SourceMap::from_fn(9, 4, |x, y| Source::new((x * 3 + y) % 5, (x + y) % 3))
    }

    #[test]
    fn maps_are_read_as_written() {
        let folder = tempfile::tempdir().unwrap();
        let map = SourceMap::from_fn(5, 3, |x, y| Source::new(x * 16_000, 65_535 - y));
        for name in ["map.png", "map.EXR"] {
            let path = folder.path().join(name);
            write(&map, &path).unwrap();
            assert_eq!(read_map(&path).unwrap(), map, "{name}");
        }
        assert!(write(&map, &folder.path().join("map.jpg")).unwrap_err().to_string().ends_with(".png or .exr"));
        let path = folder.path().join("other.png");
        Picture::filled(3, 3, glam::Vec3::ONE).write(&path).unwrap();
        assert!(read_map(&path).unwrap_err().to_string().contains("map: found Rgb8, expected RGB of 16 bits"));
        let path = folder.path().join("other.exr");
        Picture::filled(3, 3, glam::Vec3::ONE).write(&path).unwrap();
        assert!(read_map(&path).unwrap_err().to_string().ends_with("map: there is no channel x"));
    }

    #[test]
    fn pngs_keep_their_depth_and_channels() {
        let (folder, map) = (tempfile::tempdir().unwrap(), example());
        let [input, output] = ["in.png", "out.png"].map(|name| folder.path().join(name));
        for color in [ExtendedColorType::L8, ExtendedColorType::Rgb8, ExtendedColorType::L16, ExtendedColorType::Rgba16]
        {
            let size = usize::from(color.bits_per_pixel()) / 8;
            let pixels: Vec<u8> = (0..15 * size).map(|i| (i * 37 % 251) as u8).collect();
            image::save_buffer_with_format(&input, &pixels, 5, 3, color, ImageFormat::Png).unwrap();
            apply(&map, &input, &output).unwrap();
            let found = image::open(&output).unwrap();
            assert_eq!((ExtendedColorType::from(found.color()), found.width(), found.height()), (color, 9, 4));
            for (pixel, source) in found.as_bytes().chunks_exact(size).zip(&map.sources) {
                assert_eq!(pixel, &pixels[source.texel(5) * size..][..size], "{color:?}");
            }
        }
    }

    #[test]
    fn exrs_keep_their_channels_bit_by_bit() {
        let (folder, map) = (tempfile::tempdir().unwrap(), example());
        let [input, output] = ["in.exr", "out.exr"].map(|name| folder.path().join(name));
        let numbers = |k: u32| (0..15u32).map(move |i| crate::random::mix((i + 100 * k).into()) as u32 >> 4);
        let float = FlatSamples::F32(numbers(0).map(f32::from_bits).collect());
        let half = FlatSamples::F16(numbers(1).map(|v| half::f16::from_bits(v as u16 & 0x7bff)).collect());
        let whole = FlatSamples::U32(numbers(2).collect());
        let channels = [("depth", float.clone()), ("height", half.clone()), ("id", whole.clone())];
        let channels = channels.into_iter().map(|(name, samples)| AnyChannel::new(name, samples)).collect();
        let layer = Layer::new((5, 3), LayerAttributes::named("maps"), lossless(), AnyChannels::sort(channels));
        Image::from_layer(layer).write().to_file(&input).unwrap();
        apply(&map, &input, &output).unwrap();
        let found = read_exr(&output, &fs::read(&output).unwrap()).unwrap();
        let layer = &found.layer_data[0];
        assert_eq!(
            (layer.size, layer.attributes.layer_name.as_ref().unwrap().to_string()),
            (Vec2(9, 4), "maps".into())
        );
        for (channel, samples) in layer.channel_data.list.iter().zip([float, half, whole]) {
            assert_eq!(channel.sample_data, moved(&samples, &map, 5), "{}", channel.name);
        }
        let wrong = SourceMap::from_fn(2, 2, |_, _| Source::new(5, 0));
        let error = apply(&wrong, &input, &output).unwrap_err().to_string();
        assert_eq!(error, "map: texel (0, 0) copies texel (5, 0), but the sample has 5 x 3");
        let error = apply(&map, &input, &folder.path().join("out.png")).unwrap_err().to_string();
        assert!(error.ends_with("holds floating-point numbers, which are written as .exr"), "{error}");
        fs::write(&input, &fs::read(&input).unwrap()[..100]).unwrap();
        assert!(apply(&map, &input, &output).is_err());
    }
}
