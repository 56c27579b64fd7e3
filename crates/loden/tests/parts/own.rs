//! A codec of another program, and parts made in memory.

use std::fs;
use std::path::Path;

use glam::{Vec2, Vec3};
use loden::btf::{BtfMeta, BtfSource, Cosine, Rect, SampleType};
use loden::codec::parts::{
    Axis, Curve, Expr, MemoryParts, Numbers, Parts, PlaneKind, PlaneSpec, Provenance, Recipe, TableSpec, folder, store,
};
use loden::codec::{self, Codec, EncodeSummary};
use loden::color::Encoding;
use loden::direction::Scheme;
use loden::params::{Param, Values};
use loden::progress::{Progress, Silent};

use super::source;

/// A codec of another program: the mean of each light, times a brightness of each texel in eight bits.
struct Brightness;

impl Codec for Brightness {
    fn name(&self) -> &'static str {
        "brightness"
    }

    fn doc(&self) -> &'static str {
        "One brightness for each texel."
    }

    fn params(&self) -> &'static [Param] {
        &[]
    }

    fn recipe(&self, _meta: &BtfMeta, _params: &Values) -> loden::Result<Recipe> {
        let mut brightness = PlaneSpec::numbers("brightness", 1, SampleType::U8);
        if let PlaneKind::Numbers { range, .. } = &mut brightness.kind {
            *range = Some(1);
        }
        Ok(Recipe {
            planes: vec![brightness],
            tables: vec![
                TableSpec::new("mean", &[Axis::Component(1), Axis::Light, Axis::Channel], SampleType::F32),
                TableSpec::new("brightness_range", &[Axis::Component(1), Axis::Range], SampleType::F32),
            ],
            value: Expr::dot(0, 0),
            curve: Curve::Display,
        })
    }

    fn encode(
        &self,
        source: &dyn BtfSource,
        params: &Values,
        path: &Path,
        _progress: &dyn Progress,
    ) -> loden::Result<EncodeSummary> {
        let meta = source.meta();
        let writer = codec::container::Writer::create(path, self, params, source, &self.recipe(meta, params)?)?;
        let view = source.view(0)?.to_f32().into_owned();
        let mut means = Vec::new();
        for image in view.chunks_exact(meta.image_len()) {
            let sum = |channel: usize| image.iter().skip(channel).step_by(3).sum::<f32>();
            means.extend([0, 1, 2].map(|channel| sum(channel) / meta.texels() as f32));
        }
        let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        writer.write("mean", 0, &bytes(&means))?;
        writer.write("brightness_range", 0, &bytes(&[0.5, 1.0 / 255.0]))?;
        writer.write(
            "brightness",
            0,
            &(0..meta.texels()).map(|t| (t * 255 / meta.texels()) as u8).collect::<Vec<_>>(),
        )?;
        Ok(EncodeSummary { bytes: writer.commit()?, warnings: Vec::new() })
    }
}

#[test]
fn a_file_of_an_unknown_codec_is_decoded_by_its_recipe() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("x.loden");
    let source = source(SampleType::U8, Encoding::Srgb, Cosine::Included);
    Brightness.encode(&source, &Values::defaults(&[]), &path, &Silent).unwrap();
    for btf in [codec::open(&path).unwrap(), codec::open_with(&path, &[&Brightness]).unwrap()] {
        assert_eq!(btf.method(), "brightness");
        let means = btf.parts().table(0).unwrap().to_f32();
        let image = btf.image(2, 3).unwrap().to_f32().into_owned();
        for (texel, rgb) in image.chunks_exact(3).enumerate() {
            let brightness = 0.5 + (texel * 255 / source.meta().texels()) as f32 / 255.0;
            for channel in 0..3 {
                assert!((rgb[channel] - brightness * means[9 + channel]).abs() < 1e-6);
            }
        }
        let (centre, light) = (Vec2::new(0.5 / 7.0, 1.0 - 0.5 / 5.0), btf.meta().lights.directions()[3]);
        let found = btf.material(Scheme::Triangles).unwrap().apparent(centre, light, Vec3::Z);
        let expected = Vec3::from_slice(&image).map(|v| Encoding::Srgb.decode(v));
        assert!(found.distance(expected) < 1e-5, "{found} {expected}");
        // and in parts, as any other
        let parts = temporary.path().join("parts");
        folder::write(&**btf.parts(), &btf.provenance().unwrap(), &parts).unwrap();
        let (read, from) = folder::read_folder(&parts).unwrap();
        store(&read, &from, &temporary.path().join("again.loden")).unwrap();
        let again = codec::open(temporary.path().join("again.loden")).unwrap();
        assert_eq!(again.image(2, 3).unwrap().to_f32().into_owned(), image);
        fs::remove_dir_all(&parts).unwrap();
    }
}

#[test]
fn parts_made_in_memory_are_checked() {
    let meta = source(SampleType::U8, Encoding::Srgb, Cosine::Included).meta().clone();
    let recipe = Brightness.recipe(&meta, &Values::defaults(&[])).unwrap();
    let make = |brightness: Numbers, mean: Vec<f32>| {
        let tables = vec![Numbers::F32(mean.into()), Numbers::F32(vec![0.0, 1.0].into())];
        MemoryParts::new(meta.clone(), recipe.clone(), vec![brightness], tables)
    };
    let (bytes, mean) = (|n: usize| Numbers::U8(vec![1; n].into()), vec![0.5; 30]);
    let parts = make(bytes(35), mean.clone()).unwrap();
    assert!(parts.plane(0, 0, Rect { x: 3, y: 0, width: 5, height: 1 }).is_err());
    assert!(parts.plane(1, 0, Rect::whole(&meta)).is_err() && parts.table(2).is_err());
    for (expected, made) in [
        ("brightness: found 34 numbers, expected 35", make(bytes(34), mean.clone())),
        ("brightness: found F32, expected U8", make(Numbers::F32(vec![1.0; 35].into()), mean.clone())),
        ("mean: number 7 is not finite", {
            let mut mean = mean.clone();
            mean[7] = f32::NAN;
            make(bytes(35), mean)
        }),
    ] {
        let error = made.unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    // parts of no file
    let path = tempfile::tempdir().unwrap();
    let path = path.path().join("x.loden");
    let from = Provenance::unknown(codec::container::SourceInfo {
        bytes: 0,
        sample_type: SampleType::U8,
        missing: vec![],
        identity: None,
    });
    store(&parts, &from, &path).unwrap();
    let found = codec::open(&path).unwrap().image(0, 0).unwrap().to_f32().into_owned();
    assert!(found.iter().all(|v| (v - 0.5).abs() < 1e-6));
}
