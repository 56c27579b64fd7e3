//! Files with a map decode, evaluate and are rearranged like files with rearranged planes.

use std::sync::Arc;

use glam::Vec2;

use super::*;
use crate::btf::{BtfSource, Cosine, MemoryBtf, SampleType, Texels};
use crate::codec::parts::{Provenance, store};
use crate::codec::{CODECS, CompressedBtf, Decoded, by_name, open};
use crate::color::Encoding;
use crate::direction::{DirectionSet, Scheme};
use crate::material::Point;
use crate::params::Values;
use crate::progress::Silent;
use crate::random::{hash, unit};

/// A BTF of 12 x 10 texels with a smooth change over the directions.
fn sample() -> MemoryBtf {
    let views = DirectionSet::bonn81();
    let lights = views.clone();
    let (encoding, cosine) = (Encoding::Srgb, Cosine::Included);
    let meta = BtfMeta { width: 12, height: 10, views, lights, encoding, cosine, sample_type: SampleType::U8 };
    let noise: Vec<f32> = (0..3 * 120).map(|i| unit(hash(&[7, i]))).collect();
    let mut texels = Vec::with_capacity(meta.pairs() * meta.image_len());
    for (wo, wi) in
        meta.views.directions().iter().flat_map(|wo| meta.lights.directions().iter().map(move |wi| (wo, wi)))
    {
        let shine = wi.z * (0.5 + 0.5 * wo.dot(*wi).max(0.0));
        texels.extend(noise.iter().map(|v| (40.0 + 200.0 * v * shine) as u8));
    }
    MemoryBtf::new(meta, Texels::U8(texels.into())).unwrap()
}

fn map() -> SourceMap {
    let patch = |x: usize, y: usize| hash(&[(x / 5) as u64, (y / 4) as u64]) as usize;
    SourceMap::from_fn(33, 17, |x, y| Source::new((x + patch(x, y) % 97) % 12, (y + patch(x, y) % 89) % 10))
}

fn compressed(folder: &std::path::Path, source: &MemoryBtf, name: &str) -> Arc<CompressedBtf> {
    let codec = by_name(name).unwrap();
    let path = folder.join(format!("{name}.loden"));
    let mut values = Values::defaults(codec.params());
    if codec.name() == "neural" {
        values.set("samples", "0.05").unwrap();
    }
    codec.encode(source, &values, &path, &Silent).unwrap();
    open(path).unwrap()
}

fn image(btf: &dyn BtfSource, view: usize, light: usize) -> Vec<f32> {
    btf.image(view, light).unwrap().to_f32().into_owned()
}

#[test]
fn every_codec_stores_a_map_and_decodes_through_it() {
    let (folder, source, map) = (tempfile::tempdir().unwrap(), sample(), map());
    for codec in CODECS {
        let small = compressed(folder.path(), &source, codec.name());
        let path = folder.path().join("large.loden");
        let bytes = store_mapped(&small, &map, &path).unwrap();
        assert_eq!(bytes, std::fs::metadata(&path).unwrap().len(), "{}", codec.name());
        let large = open(&path).unwrap();
        assert_eq!((large.meta().width, large.meta().height, large.method()), (33, 17, codec.name()));
        let (one, many) = (image(&*small, 7, 30), image(&*large, 7, 30));
        for (texel, source) in map.sources.iter().enumerate() {
            assert_eq!(many[3 * texel..][..3], one[3 * source.texel(12)..][..3], "{}: {texel}", codec.name());
        }
        // the planes are rearranged too: stored as such, they decode to the same, unless a height looks beyond the seams
        if codec.name() == "neural" {
            continue;
        }
        let stored = folder.path().join("planes.loden");
        let from = Provenance::unknown(small.source().clone());
        store(&**large.parts(), &from, &stored).unwrap();
        let planes = open(&stored).unwrap();
        assert!(planes.source_map().is_none());
        let error = image(&*planes, 7, 30).iter().zip(&many).fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
        assert!(error < 1e-3, "{}: {error}", codec.name());
    }
}

#[test]
fn materials_are_those_of_rearranged_planes_except_at_seams() {
    let (folder, source, map) = (tempfile::tempdir().unwrap(), sample(), Arc::new(map()));
    for name in ["pca", "kmeans", "dfmf"] {
        let small = compressed(folder.path(), &source, name);
        let through = small.decoded().mapped(map.clone()).unwrap();
        let planes = Decoded::new(through.parts().clone()).unwrap();
        let [through, planes] = [&through, &planes].map(|decoded| decoded.material(Scheme::Triangles).unwrap());
        assert_eq!(through.texels(), Some([33, 17]));
        let directions = source.meta().views.directions();
        let mut seams = 0;
        let mut points = vec![];
        for k in 0..400u64 {
            let [u, v] = [0, 1].map(|axis| unit(hash(&[k, axis])));
            let (wi, wo) = (directions[k as usize % 60], directions[k as usize * 7 % 60]);
            let (a, b) = (through.apparent(Vec2::new(u, v), wi, wo), planes.apparent(Vec2::new(u, v), wi, wo));
            seams += usize::from((a - b).abs().max_element() > 2e-3 * (0.1 + b.max_element()));
            points.push((Point { uv: Vec2::new(u, v), wo }, wi, a));
        }
        // half of the places are at seams; there, blending after the curve instead of before it differs a little
        assert!(seams < 240, "{name}: {seams} of 400 places differ");
        let (prepared, wi): (Vec<Point>, Vec<_>) = points.iter().map(|(point, wi, _)| (*point, *wi)).unzip();
        let (all, mut values) = ((0..400).collect::<Vec<u32>>(), vec![glam::Vec3::ZERO; 400]);
        through.prepare(&prepared).apparent(&all, &wi, &mut values);
        for (value, (_, _, expected)) in values.iter().zip(&points) {
            assert!((value - expected).abs().max_element() < 1e-5, "{name}: {value} {expected}");
        }
    }
}

#[test]
fn maps_follow_each_other() {
    let (folder, source, map) = (tempfile::tempdir().unwrap(), sample(), map());
    let small = compressed(folder.path(), &source, "klt");
    let [once, twice] = ["once", "twice"].map(|name| folder.path().join(name).with_extension("loden"));
    store_mapped(&small, &map, &once).unwrap();
    let again = SourceMap::from_fn(50, 3, |x, y| Source::new((x * 5) % 33, (y * 11) % 17));
    store_mapped(&open(&once).unwrap(), &again, &twice).unwrap();
    let found = open(&twice).unwrap();
    assert_eq!(found.source_map(), Some(&again.after(&map).unwrap()));
    assert_eq!(found.source_map().unwrap().at(2, 1), map.at(10, 11));
}

#[test]
fn damaged_and_foreign_maps_are_refused() {
    let map = map();
    assert!(map.check(12, 10).is_ok());
    let error = map.check(11, 10).unwrap_err().to_string();
    assert!(error.contains("copies texel (11, ") && error.ends_with("but the sample has 11 x 10"), "{error}");
    let short = SourceMap { height: 18, ..map.clone() };
    assert_eq!(short.check(12, 10).unwrap_err().to_string(), "map: found 561 sources for 33 x 18 texels");
    let (folder, source) = (tempfile::tempdir().unwrap(), sample());
    let small = compressed(folder.path(), &source, "pca");
    let path = folder.path().join("large.loden");
    store_mapped(&small, &map, &path).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let text = String::from_utf8_lossy(&whole).into_owned();
    let place = text.find(r#"\"width\":33"#).unwrap();
    for (with, expected) in [(&b"\\\"width\\\":34"[..], "tensor sources"), (b"\\\"width\\\":0x", "sources: ")] {
        let mut bytes = whole.clone();
        bytes[place..place + with.len()].copy_from_slice(with);
        std::fs::write(&path, &bytes).unwrap();
        let error = open(&path).err().unwrap().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn maps_of_the_first_files_are_read() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/mapped/zlib.loden");
    let found = open(path).unwrap();
    assert_eq!(found.source_map(), Some(&SourceMap::from_fn(20, 9, |x, y| Source::new(x % 3, y % 2))));
    // stored again it is smaller, and the same map
    let folder = tempfile::tempdir().unwrap();
    let again = folder.path().join("again.loden");
    let itself = SourceMap::from_fn(20, 9, Source::new);
    assert!(store_mapped(&found, &itself, &again).unwrap() < std::fs::metadata(path).unwrap().len());
    assert_eq!(open(&again).unwrap().source_map(), found.source_map());
}
