//! PVMF on the Bonn-sized benchmark set: encoding, decoding of views, evaluation of texels, comparison.
//!
//! `LODEN_BENCH_BTF=FILE cargo bench --bench pvmf`, where FILE holds raw 8-bit values of shape [81][81][256][256][3] on
//! the Bonn directions. Prints a JSON line per measurement, with the keys of the programs in `benches/peers/`. With
//! `LODEN_BENCH_REPEAT`, each measurement is the fastest of that many, since other work can only add time. Besides
//! elapsed seconds, the processor seconds of this program are given, which depend less on other work. Arguments such as
//! `-- encode f16` select measurements. Files are kept in the folder `LODEN_BENCH_OUT` if it is set;
//! `LODEN_BENCH_COMPONENTS` defaults to 4. The file `LODEN_BENCH_KLT`, of the same set, is evaluated as well.

mod measure;

use std::borrow::Cow;
use std::fs::File;
use std::path::Path;

use glam::{Vec2, Vec3};
use loden::btf::{BtfMeta, BtfSource, Cosine, SampleType, Texels};
use loden::codec::{self, CompressedBtf};
use loden::color::Encoding;
use loden::direction::{DirectionSet, Scheme, cosine_hemisphere};
use loden::material::Point;
use loden::params::Values;
use loden::progress::Silent;
use measure::{Outcome, fastest, peak_rss};
use memmap2::{Mmap, UncheckedAdvice};
use rayon::prelude::*;
use serde_json::json;

const PRECISIONS: [&str; 3] = ["f32", "f16", "u8"];
const QUERIES: usize = 2_000_000;
/// Points per batch.
const BATCH: usize = 64;

/// The raw file; pages of finished views are released.
struct RawFile {
    meta: BtfMeta,
    map: Mmap,
}

impl RawFile {
    fn open(path: &Path) -> Outcome<Self> {
        let meta = BtfMeta {
            width: 256,
            height: 256,
            views: DirectionSet::bonn81(),
            lights: DirectionSet::bonn81(),
            encoding: Encoding::Gamma(1.6),
            cosine: Cosine::Included,
            sample_type: SampleType::U8,
        };
        // SAFETY: nothing writes to the file of the benchmark while it runs.
        let map = unsafe { Mmap::map(&File::open(path)?)? };
        if map.len() as u64 != meta.raw8_bytes() {
            return Err(format!("{}: found {} bytes, expected {}", path.display(), map.len(), meta.raw8_bytes()).into());
        }
        Ok(Self { meta, map })
    }
}

impl BtfSource for RawFile {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn view(&self, view: usize) -> loden::Result<Texels<'_>> {
        let len = self.meta.view_len();
        Ok(Texels::U8(Cow::Borrowed(&self.map[view * len..(view + 1) * len])))
    }

    fn image(&self, view: usize, light: usize) -> loden::Result<Texels<'_>> {
        let len = self.meta.image_len();
        let image = view * self.meta.lights.len() + light;
        Ok(Texels::U8(Cow::Borrowed(&self.map[image * len..(image + 1) * len])))
    }

    fn source_bytes(&self) -> u64 {
        self.map.len() as u64
    }

    fn release(&self, view: usize) {
        let len = self.meta.view_len();
        // SAFETY: a read-only map of a file: released pages are read again when touched.
        let _ = unsafe { self.map.unchecked_advise_range(UncheckedAdvice::DontNeed, view * len, len) };
    }
}

fn main() -> Outcome<()> {
    let Some(path) = std::env::var_os("LODEN_BENCH_BTF") else {
        println!("skipped: LODEN_BENCH_BTF does not name the benchmark set");
        return Ok(());
    };
    let repeat: usize = std::env::var("LODEN_BENCH_REPEAT").ok().and_then(|n| n.parse().ok()).unwrap_or(1);
    let components = std::env::var("LODEN_BENCH_COMPONENTS").unwrap_or("4".into());
    let source = RawFile::open(Path::new(&path))?;
    let temporary = tempfile::tempdir()?;
    let folder = std::env::var_os("LODEN_BENCH_OUT").map_or(temporary.path().to_path_buf(), Into::into);
    // cargo passes `--bench`
    let only: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let wanted = |work: &str| only.is_empty() || only.iter().any(|o| o == work);
    let precisions = match only.iter().find(|o| PRECISIONS.contains(&o.as_str())) {
        Some(one) => vec![one.as_str()],
        None => PRECISIONS.to_vec(),
    };
    let encode = only.iter().all(|o| PRECISIONS.contains(&o.as_str())) || only.iter().any(|o| o == "encode");
    for &precision in &precisions {
        let file = folder.join(format!("{precision}.loden"));
        if file.exists() && !encode {
            continue;
        }
        let values = Values::new(
            codec::by_name("pvmf")?.params(),
            [("components", components.as_str()), ("precision", precision)],
        )?;
        let (seconds, processor) =
            fastest(repeat, || Ok(codec::by_name("pvmf")?.encode(&source, &values, &file, &Silent).map(drop)?))?;
        let bytes = std::fs::metadata(&file)?.len();
        println!(
            "{}",
            json!({"work": "pvmf encode", "precision": precision, "seconds": seconds, "processor_seconds": processor, "peak_rss_bytes": peak_rss(),
                   "bytes": bytes, "threads": rayon::current_num_threads()})
        );
    }
    for &precision in &precisions {
        let file = folder.join(format!("{precision}.loden"));
        if wanted("decode") {
            decode(&file, precision, repeat)?;
        }
        if wanted("evaluate") {
            evaluate("pvmf", &*codec::open(&file)?, precision, repeat)?;
        }
    }
    if let Some(file) = std::env::var_os("LODEN_BENCH_KLT").filter(|_| wanted("evaluate")) {
        evaluate("klt", &*codec::open(file)?, "u8", repeat)?;
    }
    if !wanted("compare") {
        return Ok(());
    }
    let (seconds, processor) = fastest(repeat, || {
        let test = codec::open(folder.join(format!("{}.loden", precisions[0])))?;
        let report = loden::metric::compare(&source, &*test, &Silent)?;
        println!("{}", serde_json::to_string(&report)?);
        Ok(())
    })?;
    println!(
        "{}",
        json!({"work": "compare", "seconds": seconds, "processor_seconds": processor, "peak_rss_bytes": peak_rss()})
    );
    Ok(())
}

/// Decodes whole views into existing buffers, one view per thread at a time, and on one thread.
fn decode(file: &Path, precision: &str, repeat: usize) -> Outcome<()> {
    let btf = codec::open(file)?;
    let meta = btf.meta();
    let threads = rayon::current_num_threads();
    for used in [1, threads] {
        let views = 16 * used;
        let mut buffers = vec![vec![0.0f32; meta.view_len()]; used];
        buffers.iter_mut().for_each(|b| b.fill(1.0));
        let (seconds, processor) = fastest(repeat.max(3), || {
            buffers.par_iter_mut().enumerate().try_for_each(|(i, buffer)| {
                (i..views).step_by(used).try_for_each(|view| btf.decode_view(view, buffer))
            })?;
            Ok(())
        })?;
        let texels = (views * meta.lights.len() * meta.texels()) as f64;
        println!(
            "{}",
            json!({"work": "pvmf decode view", "precision": precision, "threads": used,
                   "gtexel_per_second": texels / seconds * 1e-9,
                   "gtexel_per_processor_second": texels / processor * 1e-9})
        );
    }
    Ok(())
}

/// Evaluates random texels at random directions, on one thread.
fn evaluate(method: &str, btf: &CompressedBtf, precision: &str, repeat: usize) -> Outcome<()> {
    let material = btf.material(Scheme::Triangles)?;
    let texels = btf.meta().texels();
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u32 << 24) as f32
    };
    let mut direction = || cosine_hemisphere(Vec2::new(random(), random()));
    let pairs: Vec<(Vec3, Vec3)> = (0..QUERIES).map(|_| (direction(), direction())).collect();
    // the set has 256 x 256 texels, so these are exactly texel centres
    let centre = |i: usize| {
        let texel = i.wrapping_mul(2_654_435_761) % texels;
        Vec2::new((texel % 256) as f32 + 0.5, 255.5 - (texel / 256) as f32) / 256.0
    };
    let points: Vec<Point> = pairs.iter().enumerate().map(|(i, pair)| Point { uv: centre(i), wo: pair.1 }).collect();
    let lights: Vec<Vec3> = pairs.iter().map(|pair| pair.0).collect();
    let index: Vec<u32> = (0..BATCH as u32).collect();
    let mut out = vec![Vec3::ZERO; points.len()];
    type Run<'a> = (&'a str, &'a dyn Fn(&mut [Vec3]));
    let runs: [Run; 4] = [
        ("batch", &|out| material.apparent_many(&points, &lights, out)),
        ("prepared", &|out| {
            for ((points, wi), out) in points.chunks(BATCH).zip(lights.chunks(BATCH)).zip(out.chunks_mut(BATCH)) {
                material.prepare(points).apparent(&index[..out.len()], wi, out);
            }
        }),
        ("single", &|out| {
            for ((out, point), wi) in out.iter_mut().zip(&points).zip(&lights) {
                *out = material.apparent(point.uv, *wi, point.wo);
            }
        }),
        ("bilinear", &|out| {
            for ((out, point), wi) in out.iter_mut().zip(&points).zip(&lights) {
                *out = material.apparent(point.uv - 0.5 / 256.0, *wi, point.wo);
            }
        }),
    ];
    for (name, run) in runs {
        let (seconds, processor) = fastest(repeat.max(3), || {
            run(&mut out);
            Ok(())
        })?;
        let mean = out.iter().sum::<Vec3>() / out.len() as f32;
        println!(
            "{}",
            json!({"work": format!("{method} evaluate"), "call": name, "precision": precision,
                   "evaluations_per_second_per_core": QUERIES as f64 / seconds,
                   "evaluations_per_processor_second": QUERIES as f64 / processor, "mean": mean.to_array()})
        );
    }
    Ok(())
}
