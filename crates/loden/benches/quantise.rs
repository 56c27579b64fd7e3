//! Quantisers and local components on the Bonn-sized benchmark set: encoding from a raw array, and the error.
//!
//! `LODEN_BENCH_BTF=FILE.toml cargo bench --bench quantise`, where FILE is a raw array as written by `loden convert`.
//! Prints a JSON line per method, with the keys of `benches/peers/quantise.py`. Arguments such as `-- kmeans` select
//! methods. With `LODEN_BENCH_REPEAT`, each measurement is the fastest of that many.

mod measure;

use loden::codec;
use loden::import;
use loden::params::Values;
use loden::progress::Silent;
use measure::{Outcome, fastest, peak_rss};
use serde_json::json;

/// Method and parameters.
type Run = (&'static str, &'static [(&'static str, &'static str)]);

const RUNS: [Run; 8] = [
    ("median-cut", &[("split", "balanced")]),
    ("median-cut", &[("split", "longest-edge")]),
    ("median-cut", &[("split", "population")]),
    ("median-cut", &[("split", "variance")]),
    ("median-cut", &[("split", "variance"), ("space", "pca")]),
    ("kmeans", &[]),
    ("tsvq", &[]),
    ("pcmf", &[]),
];

fn main() -> Outcome<()> {
    let Some(path) = std::env::var_os("LODEN_BENCH_BTF") else {
        println!("skipped: LODEN_BENCH_BTF does not name the benchmark set");
        return Ok(());
    };
    let repeat: usize = std::env::var("LODEN_BENCH_REPEAT").ok().and_then(|n| n.parse().ok()).unwrap_or(1);
    // cargo passes `--bench`
    let only: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with('-')).collect();
    let source = import::open(path, &Default::default())?;
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("x.loden");
    for (method, params) in RUNS.iter().filter(|(method, _)| only.is_empty() || only.iter().any(|o| o == method)) {
        let codec = codec::by_name(method)?;
        let values = Values::new(codec.params(), params.iter().copied())?;
        reset_peak_rss();
        let (seconds, processor) =
            fastest(repeat, || Ok(codec.encode(source.as_ref(), &values, &file, &Silent).map(drop)?))?;
        let peak = peak_rss();
        let report = loden::metric::compare(source.as_ref(), codec::open(&file)?.as_ref(), &Silent)?;
        let words: Vec<&str> = std::iter::once(*method).chain(params.iter().map(|p| p.1)).collect();
        println!(
            "{}",
            json!({"work": words.join(" "), "seconds": seconds, "processor_seconds": processor, "peak_rss_bytes": peak, "bytes": std::fs::metadata(&file)?.len(),
                   "mean_abs_error": report.mean_abs_error, "rmse": report.rmse})
        );
    }
    Ok(())
}

/// Resets the peak resident set size, on Linux.
fn reset_peak_rss() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}
