//! Parts as a folder of files that other programs can open, and back.
//!
//! # Model
//! | file | content |
//! |---|---|
//! | [`MANIFEST`] | size and directions of the BTF, the recipe, and the origin of the parts |
//! | `PLANE.png` | an index plane: 8-bit grey for up to 256 rows, else 16-bit grey |
//! | `PLANE.exr` | a plane of numbers with one channel each, `00000` first; half precision, also for 8-bit numbers, or single |
//! | `PLANE-VIEW.exr` | the same for each view, `000` first, if each view has its own numbers |
//! | `TABLE.npy` | a table in NumPy's format, with its stored type and the shape of its axes |
//!
//! Nothing is lost: what is read back equals what was written, bit for bit.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder, MetaData, ReadChannels,
    ReadLayers, WritableImage, read,
};
use half::f16;
use image::{DynamicImage, ExtendedColorType, ImageFormat, ImageReader};
use serde::{Deserialize, Serialize};

use super::{MemoryParts, Numbers, Parts, PlaneKind, PlaneSpec, Provenance, Recipe};
use super::{carrier, npy};
use crate::btf::{BtfMeta, Rect, SampleType};
use crate::codec::container::{READABLE, VERSION, VERSION_WITH_SOURCES, check_size};
use crate::input::{self, guarded};
use crate::output::{OutputDir, failed};
use crate::picture::decode::dwa;
use crate::{Error, Result};

/// Name of the file that describes the others.
pub const MANIFEST: &str = "recipe.json";

/// Maximum size of the manifest in bytes.
const MAX_MANIFEST: u64 = 16 << 20;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Manifest {
    loden: String,
    btf: BtfMeta,
    recipe: Recipe,
    provenance: Provenance,
}

/// Writes parts into a folder, which must be empty or not exist, and returns the number of files.
///
/// # Errors
/// Errors of reading the parts; [`Error::Io`].
pub fn write(parts: &dyn Parts, from: &Provenance, folder: &Path) -> Result<usize> {
    let output = OutputDir::create(folder)?;
    let (meta, recipe, into) = (parts.meta(), parts.recipe(), output.folder());
    let mut files = 1;
    for (plane, spec) in recipe.planes.iter().enumerate() {
        let names = file_names(spec, meta);
        for (view, name) in names.iter().enumerate() {
            let numbers = parts.plane(plane, view, Rect::whole(meta))?;
            put(&into.join(name), &picture(&numbers, spec, meta).map_err(|e| Error::invalid(folder, name, e))?)?;
        }
        files += names.len();
    }
    for (table, spec) in recipe.tables.iter().enumerate() {
        put(&into.join(format!("{}.npy", spec.name)), &npy::write(&parts.table(table)?, &spec.tensor(meta).shape))?;
        files += 1;
    }
    let btf = BtfMeta { sample_type: from.source.sample_type, ..meta.clone() };
    let manifest = Manifest { loden: VERSION.into(), btf, recipe: recipe.clone(), provenance: from.clone() };
    let text = serde_json::to_string_pretty(&manifest).map_err(|e| Error::io(folder)(e.into()))?;
    put(&into.join(MANIFEST), (text + "\n").as_bytes())?;
    output.commit()?;
    Ok(files)
}

/// Reads parts and their origin from a folder, also from one of [`carrier`] pictures.
///
/// # Errors
/// [`Error::Invalid`], [`Error::Limit`] or [`Error::Unsupported`] naming the file and the field; [`Error::Io`].
pub fn read_folder(folder: &Path) -> Result<(MemoryParts, Provenance)> {
    if folder.join(carrier::MANIFEST).is_file() {
        return carrier::read(folder);
    }
    let path = folder.join(MANIFEST);
    let Manifest { btf, recipe, provenance, .. } = manifest(&path)?;
    check_size(&path, &btf)?;
    btf.check_pairs().map_err(|error| Error::invalid(&path, "btf", error.to_string()))?;
    let located = |path: &Path, error: Error| match error {
        Error::Parameter { name, problem } => Error::invalid(path, name, problem),
        other => other,
    };
    recipe.check(&btf).map_err(|e| located(&path, e))?;
    provenance.source.check(&btf).map_err(|problem| Error::invalid(&path, "provenance.source", problem))?;
    let plane = |spec: &PlaneSpec| {
        let views = file_names(spec, &btf).into_iter().map(|name| read_plane(&folder.join(name), spec, &btf));
        let views = views.collect::<Result<Vec<_>>>()?;
        Numbers::concat(&views).ok_or_else(|| Error::invalid(folder, &spec.name, "its file is missing"))
    };
    let planes = recipe.planes.iter().map(plane).collect::<Result<Vec<_>>>()?;
    let table = |spec: &super::TableSpec| {
        let path = folder.join(format!("{}.npy", spec.name));
        let numbers = npy::read(&path, &spec.tensor(&btf))?;
        numbers.check(&spec.name, Some(spec.sample_type), numbers.len()).map_err(|e| located(&path, e))?;
        Ok(numbers)
    };
    let tables = recipe.tables.iter().map(table).collect::<Result<Vec<_>>>()?;
    let parts = MemoryParts::new(btf, recipe, planes, tables).map_err(|e| located(folder, e))?;
    Ok((parts, provenance))
}

fn manifest(path: &Path) -> Result<Manifest> {
    let bytes = fs::metadata(path).map_err(Error::io(path))?.len();
    if bytes > MAX_MANIFEST {
        return Err(Error::Limit { path: path.into(), field: "bytes".into(), found: bytes, limit: MAX_MANIFEST });
    }
    let text = fs::read(path).map_err(Error::io(path))?;
    let manifest: Manifest =
        serde_json::from_slice(&text).map_err(|e| Error::invalid(path, "JSON", input::in_words(&e.to_string())))?;
    match &manifest.loden[..] {
        version if READABLE.contains(&version) => Ok(manifest),
        other => {
            Err(Error::unsupported(path, format!("version {other:?}; this program reads up to {VERSION_WITH_SOURCES}")))
        }
    }
}

/// The files of a plane: one, or one per view.
fn file_names(spec: &PlaneSpec, meta: &BtfMeta) -> Vec<String> {
    match spec.kind {
        PlaneKind::Index { .. } => vec![format!("{}.png", spec.name)],
        _ if spec.per_view() => (0..meta.views.len()).map(|view| format!("{}-{view:03}.exr", spec.name)).collect(),
        _ => vec![format!("{}.exr", spec.name)],
    }
}

fn put(path: &Path, bytes: &[u8]) -> Result<()> {
    fs::write(path, bytes).map_err(failed(path))
}

/// Content of a plane's file.
fn picture(numbers: &Numbers, spec: &PlaneSpec, meta: &BtfMeta) -> std::result::Result<Vec<u8>, String> {
    let mut file = Cursor::new(Vec::new());
    let (width, height, count) = (meta.width, meta.height, spec.count());
    /// One number of each texel.
    fn channel<T: Copy, U>(all: &[T], k: usize, count: usize, number: impl Fn(T) -> U) -> Vec<U> {
        all.iter().skip(k).step_by(count).map(|&v| number(v)).collect()
    }
    let samples = |k: usize| match numbers {
        Numbers::U8(all) => FlatSamples::F16(channel(all, k, count, |v| f16::from_f32(f32::from(v)))),
        Numbers::Index(all) => FlatSamples::U32(channel(all, k, count, u32::from)),
        Numbers::F16(all) => FlatSamples::F16(channel(all, k, count, |v| v)),
        Numbers::F32(all) => FlatSamples::F32(channel(all, k, count, |v| v)),
    };
    if let (Numbers::Index(index), PlaneKind::Index { rows }) = (numbers, &spec.kind) {
        let (bytes, color) = match *rows {
            0..=256 => (index.iter().map(|&k| k as u8).collect::<Vec<u8>>(), ExtendedColorType::L8),
            _ => (index.iter().flat_map(|k| k.to_ne_bytes()).collect(), ExtendedColorType::L16),
        };
        let (width, height) = (width as u32, height as u32);
        image::write_buffer_with_format(&mut file, &bytes, width, height, color, ImageFormat::Png)
            .map_err(|e| e.to_string())?;
    } else {
        let channels = (0..count).map(|k| AnyChannel::new(channel_name(k).as_str(), samples(k))).collect();
        // otherwise blocks are stored in the order in which threads finish them
        let encoding = Encoding { line_order: LineOrder::Increasing, ..Encoding::SMALL_FAST_LOSSLESS };
        let layer = Layer::new((width, height), LayerAttributes::default(), encoding, AnyChannels::sort(channels));
        Image::from_layer(layer).write().to_buffered(&mut file).map_err(|e| e.to_string())?;
    }
    Ok(file.into_inner())
}

/// Name of a channel. A texel has at most 65535 numbers, and channels are sorted by name.
fn channel_name(k: usize) -> String {
    format!("{k:05}")
}

fn read_plane(path: &Path, spec: &PlaneSpec, meta: &BtfMeta) -> Result<Numbers> {
    let bytes = fs::read(path).map_err(Error::io(path))?;
    match spec.kind {
        PlaneKind::Index { rows } => {
            let numbers = read_png(path, &bytes, rows, meta)?;
            super::memory::check_index(&numbers, rows).map_err(|problem| Error::invalid(path, "pixels", problem))?;
            Ok(numbers)
        }
        PlaneKind::Numbers { sample_type, count, .. } => read_exr(path, &bytes, sample_type, count, meta),
    }
}

fn check_dimensions(path: &Path, [width, height]: [usize; 2], meta: &BtfMeta) -> Result<()> {
    if [width, height] == [meta.width, meta.height] {
        return Ok(());
    }
    let problem = format!("found {width} x {height}, expected {} x {}", meta.width, meta.height);
    Err(Error::invalid(path, "size", problem))
}

fn read_png(path: &Path, bytes: &[u8], rows: usize, meta: &BtfMeta) -> Result<Numbers> {
    let failed = |problem: String| Error::invalid(path, "PNG", problem);
    let invalid = |e: image::ImageError| failed(e.to_string());
    let reader = || ImageReader::with_format(Cursor::new(bytes), ImageFormat::Png);
    let (width, height) = guarded("PNG", || reader().into_dimensions()).map_err(failed)?.map_err(invalid)?;
    check_dimensions(path, [width as usize, height as usize], meta)?;
    let index: Vec<u16> = match guarded("PNG", || reader().decode()).map_err(failed)?.map_err(invalid)? {
        DynamicImage::ImageLuma8(_) if rows > 256 => {
            let problem = format!("found 8 bits, which cannot number {rows} rows; save it with 16 bits");
            return Err(Error::invalid(path, "pixels", problem));
        }
        DynamicImage::ImageLuma8(grey) => grey.iter().map(|&k| k.into()).collect(),
        DynamicImage::ImageLuma16(grey) => grey.into_raw(),
        other => {
            let problem = format!("found {:?}, expected grey of 8 or 16 bits", other.color());
            return Err(Error::invalid(path, "pixels", problem));
        }
    };
    Ok(Numbers::Index(index.into()))
}

fn read_exr(path: &Path, bytes: &[u8], sample_type: SampleType, count: usize, meta: &BtfMeta) -> Result<Numbers> {
    let failed = |problem: String| Error::invalid(path, "EXR", problem);
    let invalid = |e: exr::error::Error| failed(e.to_string());
    // check the header before allocating pixels
    let meta_data = guarded("EXR", || MetaData::read_from_buffered(Cursor::new(bytes), false)).map_err(failed)?;
    let headers = meta_data.map_err(invalid)?.headers;
    let header = headers.first().ok_or_else(|| Error::invalid(path, "EXR", "it has no layer"))?;
    check_dimensions(path, [header.layer_size.width(), header.layer_size.height()], meta)?;
    let names = header.channels.list.iter().map(|channel| channel.name.to_string());
    if header.channels.list.len() != count || names.enumerate().any(|(k, name)| name != channel_name(k)) {
        let problem = format!("expected {count} channels, 00000 to {}", channel_name(count - 1));
        return Err(Error::invalid(path, "channels", problem));
    }
    guarded("EXR", || dwa::check(bytes, &headers)).map_err(failed)?.map_err(invalid)?;
    // read by this thread: a panic of another could not be caught
    let image = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
    let image = image.non_parallel();
    let image = guarded("EXR", || image.from_buffered(Cursor::new(bytes))).map_err(failed)?;
    let layer = image.map_err(invalid)?.layer_data;
    let channels = layer.channel_data.list;
    let wrong = |k: usize, problem: String| Error::invalid(path, format!("channel {}", channel_name(k)), problem);
    /// Interleaves channels texel by texel; the error is the index of a channel with the wrong type.
    fn joined<T: Copy + Default>(
        channels: &[AnyChannel<FlatSamples>],
        numbers: impl Fn(&FlatSamples) -> Option<&[T]>,
    ) -> std::result::Result<Vec<T>, usize> {
        let texels = channels.first().map_or(0, |channel| channel.sample_data.len());
        let mut all = vec![T::default(); texels * channels.len()];
        for (k, channel) in channels.iter().enumerate() {
            let of_channel = numbers(&channel.sample_data).ok_or(k)?;
            all[k..].iter_mut().step_by(channels.len()).zip(of_channel).for_each(|(out, &v)| *out = v);
        }
        Ok(all)
    }
    fn halves(samples: &FlatSamples) -> Option<&[f16]> {
        if let FlatSamples::F16(values) = samples { Some(values) } else { None }
    }
    fn singles(samples: &FlatSamples) -> Option<&[f32]> {
        if let FlatSamples::F32(values) = samples { Some(values) } else { None }
    }
    let half_precision = |k| wrong(k, "found another number type, expected half precision".into());
    let numbers = match sample_type {
        SampleType::F32 => {
            let numbers = joined(&channels, singles);
            Numbers::F32(
                numbers.map_err(|k| wrong(k, "found another number type, expected single precision".into()))?.into(),
            )
        }
        SampleType::F16 => Numbers::F16(joined(&channels, halves).map_err(half_precision)?.into()),
        SampleType::U8 => {
            let numbers = joined(&channels, halves).map_err(half_precision)?;
            let whole =
                |v: &f16| (0..=255u8).contains(&(v.to_f32() as u8)) && f32::from(v.to_f32() as u8) == v.to_f32();
            if let Some(place) = numbers.iter().position(|v| !whole(v)) {
                let problem = format!("{} is not a whole number from 0 to 255", numbers[place]);
                return Err(wrong(place % count, problem));
            }
            Numbers::U8(numbers.iter().map(|v| v.to_f32() as u8).collect::<Vec<u8>>().into())
        }
    };
    let finite = match &numbers {
        Numbers::F16(values) => values.iter().position(|v| !v.is_finite()),
        Numbers::F32(values) => values.iter().position(|v| !v.is_finite()),
        _ => None,
    };
    match finite {
        Some(place) => Err(wrong(place % count, format!("texel {} is not finite", place / count))),
        None => Ok(numbers),
    }
}
