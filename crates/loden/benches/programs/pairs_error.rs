//! Measures BTFs with their own list of pairs: how well random pairs of a complete BTF predict the others.
//!
//! Usage: `pairs_error FILE COUNT`. Takes so many pairs of the BTF at random, compresses them by several methods, and evaluates
//! the materials at the other pairs, at the centres of all texels. Prints a Markdown table: bytes, the ratio to the 8-bit values
//! of the measured pairs, the mean error of their display values, and the mean difference over the mean value in linear light
//! at the other pairs; for comparison that of the nearest measured pair, unscaled and scaled by the cosines of the lights.

use glam::{Vec2, Vec3};
use loden::btf::{BtfMeta, BtfSource, MemoryBtf, SampleType, Texels};
use loden::codec::{self, Finish, Goal};
use loden::direction::{DirectionSet, Scheme};
use loden::import;
use loden::material::{Material, RawBtf};
use loden::params::Values;
use loden::progress::Silent;

const METHODS: [(&str, &[(&str, &str)]); 5] = [
    ("pvmf", &[("components", "9")]),
    ("pca", &[("components", "16")]),
    ("klt", &[]),
    ("kmeans", &[("clusters", "64")]),
    ("analytic", &[]),
];

/// Every how many pairs are evaluated.
const STEP: usize = 7;

struct Truth<'a> {
    source: &'a dyn BtfSource,
    pairs: Vec<(usize, usize)>,
}

impl Truth<'_> {
    /// The relative difference of values from the truth over all texels of these pairs.
    fn error(&self, value: impl Fn(Vec2, Vec3, Vec3, usize) -> Vec3) -> loden::Result<f64> {
        let meta = self.source.meta();
        let (mut difference, mut whole) = (0.0f64, 0.0f64);
        for &(view, light) in &self.pairs {
            let (wi, wo) = meta.pair(view, light);
            let image = self.source.image(view, light)?.to_f32().into_owned();
            for (texel, rgb) in image.as_chunks::<3>().0.iter().enumerate() {
                let (x, y) = ((texel % meta.width) as f32 + 0.5, (texel / meta.width) as f32 + 0.5);
                let uv = Vec2::new(x / meta.width as f32, 1.0 - y / meta.height as f32);
                let truth = Vec3::from_array(rgb.map(|v| meta.encoding.decode(v)));
                let found = value(uv, wi, wo, texel);
                difference += f64::from((found - truth).abs().element_sum());
                whole += f64::from(truth.element_sum());
            }
        }
        Ok(difference / whole)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [file, count] = &words[..] else { return Err("usage: pairs_error FILE COUNT".into()) };
    let source = import::open(file, &Default::default())?;
    let (meta, count) = (source.meta(), count.parse::<usize>()?.min(source.meta().pairs() - 1));
    // Shuffle all pairs
    let mut order: Vec<usize> = (0..meta.pairs()).collect();
    let mut state = 1u64;
    for i in (1..order.len()).rev() {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        order.swap(i, (state >> 33) as usize % (i + 1));
    }
    let pair = |i: &usize| (i / meta.lights.len(), i % meta.lights.len());
    let measured: Vec<_> = order[..count].iter().map(pair).collect();
    let others = order[count..].iter().step_by(STEP).map(pair).collect();
    let degrees = measured.iter().map(|&(view, light)| meta.pair_degrees(view, light));
    let degrees: Vec<[f64; 4]> = degrees.map(|[[tl, pl], [tv, pv]]| [tl, pl, tv, pv]).collect();
    let lights = DirectionSet::of_pairs(&degrees)?;
    let listed = BtfMeta { views: DirectionSet::normal(), lights, sample_type: SampleType::F32, ..meta.clone() };
    let images = measured.iter().map(|&(view, light)| Ok(source.image(view, light)?.to_f32().into_owned()));
    let values = images.collect::<loden::Result<Vec<_>>>()?.concat();
    let sparse = MemoryBtf::new(listed, Texels::F32(values.into()))?;
    let truth = Truth { source: source.as_ref(), pairs: others };
    println!(
        "| method | bytes | raw / bytes | error of display values | error at other pairs |\n|---|---|---|---|---|"
    );
    let nearest = |scaled: bool| {
        let (sparse, values) = (&sparse, sparse.view(0));
        let values = values.map(|values| values.to_f32().into_owned());
        values.and_then(|values| {
            truth.error(|_, wi, wo, texel| {
                let light = sparse.meta().nearest_pair(wi, wo).1;
                let cosine = if scaled { wi.z / sparse.meta().pair(0, light).0.z.max(0.05) } else { 1.0 };
                let at = light * sparse.meta().image_len() + 3 * texel;
                Vec3::from([0, 1, 2].map(|c| sparse.meta().encoding.decode(values[at + c]))) * cosine
            })
        })
    };
    println!("| nearest pair | | | | {:.4} |", nearest(false)?);
    println!("| nearest pair, by cosines | | | | {:.4} |", nearest(true)?);
    let raw = RawBtf::new(&sparse as &dyn BtfSource, Scheme::Triangles)?;
    println!("| images | | | | {:.4} |", truth.error(|uv, wi, wo, _| raw.apparent(uv, wi, wo))?);
    let folder = tempfile::tempdir()?;
    for (name, given) in METHODS {
        let (codec, path) = (codec::by_name(name)?, folder.path().join(name));
        let params = Values::new(codec.params(), given.iter().copied())?;
        let finish = Finish { measure: true, lossless: None };
        let done = codec::compress(codec, &sparse, &params, Goal::Params, finish, &path, &Silent)?;
        let material = codec::open(&path)?.material(Scheme::Triangles)?;
        let error = done.error.map_or(f64::NAN, |report| report.mean_abs_error);
        let ratio = sparse.meta().raw8_bytes() as f64 / done.bytes as f64;
        let other = truth.error(|uv, wi, wo, _| material.apparent(uv, wi, wo))?;
        println!("| {name} | {} | {ratio:.1} | {error:.4} | {other:.4} |", done.bytes);
    }
    Ok(())
}
