//! Synthesises a picture, or reads the map of another program, and prints time and measures as a line of JSON.
//!
//! Usage: `bench_synthesis EXEMPLAR.png SIDE METHOD[:NAME=VALUE] [CHANNELS [RESULT.png]]`, or with a file in place of the method, which
//! `CoordinateTransform::write` of the crate texture-synthesis made and whose name ends in `.coordinates`. Texels are
//! compared by display values; beyond three channels, by powers of them too.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::time::Instant;

use loden::params::Values;
use loden::picture::Picture;
use loden::progress::Silent;
use loden::synth::measure::Measures;
use loden::synth::{Exemplar, Goal, Source, SourceMap, by_name, synthesize};

/// The channels of a picture and powers of them.
fn exemplar(path: &str, channels: usize) -> loden::Result<Exemplar> {
    let picture = Picture::read(path, &mut Vec::new())?;
    let bytes = picture.to_srgb8();
    let value = |texel: &[u8], c: usize| (f32::from(texel[c % 3]) / 255.0).powi(1 + c as i32 / 3);
    let values = bytes.chunks_exact(3).flat_map(|texel| (0..channels).map(move |c| value(texel, c))).collect();
    Ok(Exemplar::new(picture.width, picture.height, channels, values))
}

/// The map of another program.
fn read(path: &str) -> Result<SourceMap, Box<dyn std::error::Error>> {
    let bytes = std::fs::read(path)?;
    let numbers: Vec<u32> = bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    let (width, height) = (numbers[1] as usize, numbers[2] as usize);
    let texels = &numbers[4 + 2 * numbers[3] as usize..];
    let sources = texels.chunks_exact(3).map(|texel| Source::new(texel[0] as usize, texel[1] as usize)).collect();
    Ok(SourceMap { width, height, sources })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [path, side, method] = &words[..3] else { return Err("usage: EXEMPLAR.png SIDE METHOD|MAP [CHANNELS]".into()) };
    let channels = words.get(3).map_or(Ok(3), |word| word.parse())?;
    let (exemplar, side) = (exemplar(path, channels)?, side.parse()?);
    let begin = Instant::now();
    let map = if method.ends_with(".coordinates") {
        read(method)?
    } else {
        let mut words = method.split(':');
        let (method, goal) = (by_name(words.next().unwrap_or_default())?, Goal { seed: 1, ..Goal::new(side, side) });
        let params = Values::new(method.params(), words.filter_map(|word| word.split_once('=')))?;
        synthesize(method, &exemplar, &goal, &params, &Silent)?
    };
    let seconds = begin.elapsed().as_secs_f64();
    if let Some(result) = words.get(4) {
        let picture = Picture::read(path, &mut Vec::new())?;
        let rgb = map.sources.iter().map(|source| picture.rgb[source.texel(picture.width)]).collect();
        Picture { width: map.width, height: map.height, rgb }.write(result)?;
    }
    let mut hasher = DefaultHasher::new();
    map.sources.hash(&mut hasher);
    let measures = Measures::new(&exemplar, &map);
    let row = serde_json::json!({ "seconds": seconds, "hash": hasher.finish().to_string(), "measures": measures });
    println!("{row}");
    Ok(())
}
