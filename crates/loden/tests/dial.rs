//! Goals: every method with a quality dial meets an error and a size without waste.

use std::path::Path;

use glam::Vec3;
use loden::btf::{BtfMeta, BtfSource, Cosine, MemoryBtf, SampleType, Texels};
use loden::codec::{self, CODECS, Codec, Finish, Goal, Outcome};
use loden::color::Encoding;
use loden::direction::{DirectionSet, from_angles};
use loden::params::Values;
use loden::progress::Silent;

const MEASURED: Finish = Finish { measure: true, lossless: None };

/// Texels of different gloss and colour, with noise: 10 views and lights.
fn source(width: usize, height: usize) -> MemoryBtf {
    let set = || DirectionSet::from_degrees((0..10).map(|i| [7.0 * f64::from(i), 100.0 * f64::from(i)]).collect());
    let (views, lights, encoding) = (set().unwrap(), set().unwrap(), Encoding::Srgb);
    let (cosine, sample_type) = (Cosine::Included, SampleType::U8);
    let meta = BtfMeta { width, height, views, lights, encoding, cosine, sample_type };
    let mut state = 1u32;
    let mut values = Vec::new();
    for (wo, wi) in meta.views.directions().iter().flat_map(|v| meta.lights.directions().iter().map(move |l| (v, l))) {
        for i in 0..meta.image_len() {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = (state >> 8) as f32 / (1 << 24) as f32 - 0.5;
            let (x, y, channel) = ((i / 3 % width) as f32, (i / 3 / width) as f32, (i % 3) as f32);
            let normal: Vec3 = from_angles(0.3 + 0.2 * (0.8 * x + 1.3 * y).sin(), 0.9 * x - 0.4 * y);
            let value = normal.dot(*wi).max(0.0) * (0.4 + 0.2 * (0.5 * x * y + channel).sin())
                + 0.4 * normal.dot((*wi + *wo).normalize()).max(0.0).powf(20.0 + 10.0 * y.cos());
            values.push((255.0 * value + 12.0 * noise).clamp(0.0, 255.0) as u8);
        }
    }
    MemoryBtf::new(meta, Texels::U8(values.into())).unwrap()
}

fn compress(codec: &dyn Codec, source: &dyn BtfSource, goal: Goal, path: &Path) -> loden::Result<Outcome> {
    codec::compress(codec, source, &Values::defaults(codec.params()), goal, MEASURED, path, &Silent)
}

#[test]
fn goals_are_met_and_little_is_wasted() {
    let (source, folder) = (source(24, 20), tempfile::tempdir().unwrap());
    let path = folder.path().join("x.loden");
    let meta = source.meta();
    for codec in CODECS.iter().filter(|codec| !codec.dial(meta, 0.5).is_empty()) {
        let name = codec.name();
        let at = |place| {
            let dial = codec.dial(meta, place);
            let params = Values::new(codec.params(), dial.iter().map(|(name, text)| (*name, text.as_str()))).unwrap();
            codec::compress(*codec, &source, &params, Goal::Params, MEASURED, &path, &Silent).unwrap()
        };
        let mean = |outcome: &Outcome| outcome.error.unwrap().mean_abs_error;
        let (small, middle, fine) = (at(0.0), at(0.5), at(1.0));
        assert!(small.bytes < middle.bytes && middle.bytes < fine.bytes, "{name}");
        assert!(mean(&small) > mean(&middle) && mean(&middle) > mean(&fine), "{name}");
        // the error of the middle of the dial is reached with hardly more bytes, and vice versa
        let error = 1.0001 * mean(&middle);
        let found = compress(*codec, &source, Goal::MaxError(error), &path).unwrap();
        assert!(
            mean(&found) <= error && found.bytes as f64 <= 1.1 * middle.bytes as f64,
            "{name}: {found:?} {middle:?}"
        );
        assert!(codec::open(&path).unwrap().params().iter().eq(found.params.iter()), "{name}");
        let found = compress(*codec, &source, Goal::Bytes(middle.bytes), &path).unwrap();
        assert!(found.bytes <= middle.bytes && mean(&found) <= 1.1 * mean(&middle), "{name}: {found:?} {middle:?}");
        let out_of_reach = [Goal::Bytes(100), Goal::MaxError(0.5 * mean(&fine).min(1e-9))];
        for goal in out_of_reach {
            let error = compress(*codec, &source, goal, &path).unwrap_err().to_string();
            assert!(error.contains("bytes: found 100") || error.contains("smallest error"), "{name}: {error}");
        }
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "trials are left behind");
}

#[test]
fn parameters_that_are_given_stay() {
    let (source, folder) = (source(16, 16), tempfile::tempdir().unwrap());
    let path = folder.path().join("x.loden");
    let klt = codec::by_name("klt").unwrap();
    let given = Values::new(klt.params(), [("components", "7")]).unwrap();
    let outcome =
        codec::compress(klt, &source, &given, Goal::Bytes(20_000), Finish::default(), &path, &Silent).unwrap();
    assert_eq!(outcome.params.written("components").unwrap(), "7");
    assert!(outcome.trials > 1 && outcome.error.is_none());
    // the same bytes as with these parameters given from the start
    let bytes = std::fs::read(&path).unwrap();
    klt.encode(&source, &outcome.params, &path, &Silent).unwrap();
    assert!(bytes == std::fs::read(&path).unwrap());
    let all = Values::new(klt.params(), [("components", "7"), ("step", "1")]).unwrap();
    let error =
        codec::compress(klt, &source, &all, Goal::Bytes(20_000), Finish::default(), &path, &Silent).unwrap_err();
    assert!(error.to_string().contains("nothing left to search"), "{error}");
}
