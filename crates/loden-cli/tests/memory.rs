//! Work on data that is larger than the memory it may take.

use std::fs;
use std::path::Path;

use crate::common::{failure, json, pixels, workshop};
use loden::btf::{BtfMeta, Cosine, SampleType, Texels};
use loden::color::Encoding;
use loden::direction::DirectionSet;
use loden::export;

/// A raw array `large.toml` of `side` x `side` texels under 81 lights.
fn large(at: &Path, side: usize, views: DirectionSet) {
    let meta = BtfMeta {
        width: side,
        height: side,
        views,
        lights: DirectionSet::bonn81(),
        encoding: Encoding::Srgb,
        cosine: Cosine::Included,
        sample_type: SampleType::U8,
    };
    let mut writer = export::create(at.join("large.toml"), &meta, &Default::default()).unwrap();
    for view in 0..meta.views.len() {
        let texels: Vec<u8> = (0..meta.view_len()).map(|i| (i * 7 / 64 + 31 * view) as u8).collect();
        writer.view(&Texels::U8(texels.into())).unwrap();
    }
    writer.finish().unwrap();
}

/// A raw array of 181 MB, rendered with less.
#[test]
fn rendering_keeps_its_memory() {
    let dir = workshop();
    let at = dir.path();
    large(at, 96, DirectionSet::bonn81());
    let render = |rest: &str| json(at, &format!("render --object sphere --size 64 --spp 4 {rest}"));
    let little = render("--material small.zip -o x.exr")["peak_rss_bytes"].as_u64().unwrap();
    render("--material large.toml -o whole.exr");
    for (name, mib) in [("a", 16), ("b", 48), ("c", 96)] {
        let found = render(&format!("--material large.toml --memory {mib}M -o {name}.exr"));
        assert_eq!(pixels(&at.join(format!("{name}.exr"))), pixels(&at.join("whole.exr")));
        let budget = mib << 20;
        assert!(found["paged"][0]["resident_bytes"].as_u64().unwrap() <= budget);
        let peak = found["peak_rss_bytes"].as_u64().unwrap();
        // beside what a small material takes: histograms of directions of 81 views, and what goes through on the way
        assert!(peak < little + budget + (32 << 20), "{name}: {peak} of {budget}, {little} with a small material");
    }
    let error = failure(at, "render --object sphere --material large.toml --memory 1k -o y.exr", 2);
    assert!(error.contains("memory: found 0.0 MiB, expected at least"), "{error}");
}

/// A raw array of 127 MB, compressed with less.
#[test]
fn compression_keeps_its_memory() {
    let dir = workshop();
    let at = dir.path();
    large(at, 256, DirectionSet::from_degrees((0..8).map(|k| [30.0, 45.0 * f64::from(k)]).collect()).unwrap());
    let compress = |rest: &str| json(at, &format!("compress large.toml --threads 8 {rest}"));
    let peak = |rest: &str| compress(rest)["peak_rss_bytes"].as_u64().unwrap();
    let factored = [("pvmf", 96), ("pca --components 8", 200), ("klt --components 8", 200)];
    let clustered = [("kmeans", 250), ("median-cut", 250), ("tsvq", 250), ("pcmf --clusters 8", 250)];
    for (method, mib) in factored.into_iter().chain(clustered) {
        let free = peak(&format!("--method {method} -o free.loden"));
        let kept = peak(&format!("--method {method} --memory {mib}M -o kept.loden"));
        assert!(kept <= mib << 20, "{method}: {kept} of {mib} MiB, {free} without a budget");
        assert!(method != "pvmf" || free > mib << 20, "{method}: {free} without a budget");
        let [free, kept] = ["free", "kept"].map(|name| fs::read(at.join(format!("{name}.loden"))).unwrap());
        assert!(free == kept, "{method}");
    }
    let error = failure(at, "compress large.toml --memory 50M -o x.loden", 2);
    assert!(error.contains("memory: found 50.0 MiB, expected at least"), "{error}");
}
