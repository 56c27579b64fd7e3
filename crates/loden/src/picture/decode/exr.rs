//! OpenEXR pictures.
//!
//! # Format
//! One or several parts, each with channels; `beauty.R` is the channel R of the layer `beauty`. Read are red, green and
//! blue (or X, Y and Z, or luminance with or without differences of colour, or one channel of any name) of the first part
//! and layer that has them, where the layer without name is preferred.
//!
//! # Limits
//! Deep and subsampled channels are not read.

use std::io::Cursor;

use ::exr::meta::MetaData;
use ::exr::meta::attribute::{Chromaticities, EnvironmentMap, SampleType};
use ::exr::meta::header::Header;
use ::exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use glam::DVec2;

use super::super::primaries::Primaries;
use super::{Decoded, Numbers, Problem, Result, check_content, check_size, dwa};

/// Greatest number of bytes of samples per byte of a file: constant pictures become very small.
const MAX_RATIO: usize = 1 << 16;

/// How channels make a colour.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Model {
    Rgb([usize; 3]),
    Xyz([usize; 3]),
    /// Luminance, (R - Y) / Y and (B - Y) / Y.
    Chroma([usize; 3]),
    Grey(usize),
}

/// A layer that can be read.
#[derive(Debug)]
struct Candidate {
    part: usize,
    /// Name of the part and of the layer in it.
    name: String,
    model: Model,
}

pub(super) fn decode(bytes: &[u8]) -> Result<Decoded> {
    let headers = headers(bytes)?;
    let mut warnings = Vec::new();
    let Candidate { part, model, .. } = choose(&headers, &mut warnings)?;
    let header = &headers[part];
    check(&headers, bytes.len())?;
    dwa::check(bytes, &headers).map_err(damaged)?;
    let [width, height] = size(header);
    let channels = header.channels.list.len();
    let window = header.shared_attributes.display_window;
    if header.own_attributes.layer_position != window.position || header.layer_size != window.size {
        warnings.push(format!("the data window of {width} x {height} pixels is read, not the display window"));
    }
    if header.own_attributes.environment_map == Some(EnvironmentMap::Cube) {
        return Err(Problem::Unsupported("EXR pictures of the six sides of a cube are not supported".into()));
    }
    // Read the samples of the part by this thread: a panic of another could not be caught
    let reader =
        read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes().non_parallel();
    let image = reader.from_buffered(Cursor::new(bytes)).map_err(damaged)?;
    let part = image.layer_data.into_iter().nth(part).map(|layer| layer.channel_data.list).unwrap_or_default();
    if part.len() != channels || part.iter().any(|channel| channel.sample_data.len() != width * height) {
        return Err(Problem::Invalid("the channels of the EXR image do not have its size".into()));
    }
    let of = |channel: usize, pixel: usize| match &part[channel].sample_data {
        FlatSamples::F16(samples) => samples[pixel].to_f32(),
        FlatSamples::F32(samples) => samples[pixel],
        FlatSamples::U32(samples) => samples[pixel] as f32,
    };
    // Make colours of them
    if matches!(model, Model::Xyz(_)) {
        warnings.push("the channels X, Y and Z are taken as colours of CIE XYZ".into());
    }
    let primaries = primaries(header, model);
    let luminance = primaries.luminance().map_err(Problem::Invalid)?;
    let colour = |pixel: usize| match model {
        Model::Rgb(channels) | Model::Xyz(channels) => channels.map(|channel| of(channel, pixel)),
        Model::Grey(channel) => [of(channel, pixel); 3],
        Model::Chroma([y, ry, by]) => {
            let [y, ry, by] = [y, ry, by].map(|channel| of(channel, pixel));
            let (red, blue) = ((ry + 1.0) * y, (by + 1.0) * y);
            [red, (y - luminance.x * red - luminance.z * blue) / luminance.y, blue]
        }
    };
    let numbers = (0..width * height).flat_map(colour).collect();
    let mut decoded = Decoded::new([width, height], Numbers::F32(numbers));
    // a grey picture has the white of its primaries, which is not adapted
    if !matches!(model, Model::Grey(_)) {
        decoded = decoded.with_primaries(primaries)?;
    }
    decoded.warnings = warnings;
    Ok(decoded)
}

pub(super) fn dimensions(bytes: &[u8]) -> Result<[usize; 2]> {
    let headers = headers(bytes)?;
    let chosen = choose(&headers, &mut Vec::new())?;
    Ok(size(&headers[chosen.part]))
}

fn headers(bytes: &[u8]) -> Result<impl std::ops::Deref<Target = [Header]>> {
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(damaged)?;
    Ok(meta.headers.into_vec())
}

fn size(header: &Header) -> [usize; 2] {
    [header.layer_size.width(), header.layer_size.height()]
}

fn damaged(error: ::exr::error::Error) -> Problem {
    match error {
        ::exr::error::Error::NotSupported(what) => {
            Problem::Unsupported(format!("this kind of EXR image is not supported: {what}"))
        }
        other => Problem::Invalid(format!("the EXR image is damaged: {other}")),
    }
}

/// The primaries that a part states.
fn primaries(header: &Header, model: Model) -> Primaries {
    let point = |v: ::exr::math::Vec2<f32>| DVec2::new(f64::from(v.x()), f64::from(v.y()));
    match (model, header.shared_attributes.chromaticities) {
        (Model::Xyz(_), _) => Primaries::XYZ,
        (_, None) => Primaries::REC_709,
        (_, Some(Chromaticities { red, green, blue, white })) => {
            Primaries { red: point(red), green: point(green), blue: point(blue), white: point(white) }
        }
    }
}

/// Checks all parts before anything is allocated: all of them are read.
fn check(headers: &[Header], bytes: usize) -> Result<()> {
    let mut total = 0usize;
    for header in headers {
        let [width, height] = size(header);
        check_size(width, height)?;
        if header.deep {
            return Err(Problem::Unsupported("deep EXR images are not supported".into()));
        }
        for channel in &header.channels.list {
            if channel.sampling.x() != 1 || channel.sampling.y() != 1 {
                let problem = format!("the channel {} is subsampled, which is not supported", channel.name);
                return Err(Problem::Unsupported(problem));
            }
            let sample = if channel.sample_type == SampleType::F16 { 2 } else { 4 };
            total = total.saturating_add(width * height * sample);
        }
    }
    check_content(1, 1, bytes, 1)?;
    if total > bytes.saturating_mul(MAX_RATIO) {
        return Err(Problem::Invalid(format!("{total} bytes of samples do not fit in {bytes} bytes")));
    }
    Ok(())
}

/// The layer that is read, with a warning if there are others.
fn choose(headers: &[Header], warnings: &mut Vec<String>) -> Result<Candidate> {
    let mut candidates: Vec<Candidate> = headers.iter().enumerate().flat_map(|(k, header)| layers(k, header)).collect();
    if candidates.is_empty() {
        let names =
            |header: &Header| header.channels.list.iter().map(|channel| channel.name.to_string()).collect::<Vec<_>>();
        let mut all: Vec<String> = headers.iter().flat_map(names).collect();
        let colours: Vec<usize> = (0..all.len()).filter(|&k| !is_alpha(&all[k])).collect();
        if let ([only], [_]) = (&colours[..], headers) {
            warnings.push(format!("the only channel {} is taken as grey", all[*only]));
            return Ok(Candidate { part: 0, name: String::new(), model: Model::Grey(*only) });
        }
        all.truncate(20);
        let problem = format!("found the channels {} of an EXR image, expected R, G and B, or Y", all.join(", "));
        return Err(Problem::Unsupported(problem));
    }
    // layers without a name first, then those of colours
    candidates.sort_by_key(|candidate| (!candidate.name.is_empty(), matches!(candidate.model, Model::Grey(_))));
    let chosen = candidates.remove(0);
    if !candidates.is_empty() {
        let name = |name: &str| if name.is_empty() { "the one without name".into() } else { format!("{name:?}") };
        let others: Vec<String> = candidates.iter().take(20).map(|candidate| name(&candidate.name)).collect();
        warnings.push(format!(
            "of several layers {} is read; the others are {}",
            name(&chosen.name),
            others.join(", ")
        ));
    }
    Ok(chosen)
}

/// Whether a channel holds coverage.
fn is_alpha(channel: &str) -> bool {
    matches!(channel.rsplit('.').next(), Some("A" | "a" | "AR" | "AG" | "AB"))
}

/// The layers of a part that can be read.
fn layers(part: usize, header: &Header) -> Vec<Candidate> {
    let split = |channel: &str| match channel.rsplit_once('.') {
        Some((layer, base)) => (layer.to_owned(), base.to_ascii_uppercase()),
        None => (String::new(), channel.to_ascii_uppercase()),
    };
    let channels: Vec<(String, String)> =
        header.channels.list.iter().map(|channel| split(&channel.name.to_string())).collect();
    let mut names: Vec<&String> = channels.iter().map(|(layer, _)| layer).collect();
    names.dedup();
    let part_name = header.own_attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
    let candidate = |layer: &String| {
        let place = |base: &str| channels.iter().position(|(l, b)| l == layer && b == base);
        let three = |names: [&str; 3]| Some([place(names[0])?, place(names[1])?, place(names[2])?]);
        let model = three(["R", "G", "B"])
            .or_else(|| three(["RED", "GREEN", "BLUE"]))
            .map(Model::Rgb)
            .or_else(|| three(["X", "Y", "Z"]).map(Model::Xyz))
            .or_else(|| three(["Y", "RY", "BY"]).map(Model::Chroma))
            .or_else(|| place("Y").map(Model::Grey))?;
        // the only part of a file may be named like any
        let name = if part == 0 || part_name.is_empty() || !layer.is_empty() { layer } else { &part_name };
        Some(Candidate { part, name: name.clone(), model })
    };
    names.into_iter().filter_map(candidate).collect()
}
