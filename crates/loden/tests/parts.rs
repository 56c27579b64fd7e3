//! Parts of all codecs: what fast decoders and materials make of them is what the interpreter makes of them, and they
//! can be taken out, changed, stored and read again.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use glam::{Vec2, Vec3};
use loden::btf::{BtfMeta, BtfSource, Cosine, MemoryBtf, Rect, SampleType, Texels};
use loden::codec::parts::{
    Axis, Curve, Expr, MemoryParts, Numbers, Parts, PlaneSpec, Provenance, Recipe, TableSpec, folder, store,
};
use loden::codec::{self, CODECS, Codec, Decoded, EncodeSummary, Finish, Goal};
use loden::color::Encoding;
use loden::direction::{DirectionSet, Scheme, from_angles};
use loden::params::{Kind, Param, Values};
use loden::picture::Picture;
use loden::progress::{Progress, Silent};
use loden::render::{Lighting, Settings, Studio, TextureMap, object, studio};

const SIZE: [usize; 2] = [7, 5];

/// Odd sizes, rings of directions that differ for views and lights, texels of several kinds.
fn source(sample_type: SampleType, encoding: Encoding, cosine: Cosine) -> MemoryBtf {
    let ring = |count: usize, theta: f64| (0..count).map(move |i| [theta, 360.0 * i as f64 / count as f64]);
    let set = |rings: &[(usize, f64)]| {
        DirectionSet::from_degrees(rings.iter().flat_map(|&(count, theta)| ring(count, theta)).collect()).unwrap()
    };
    let [width, height] = SIZE;
    let (views, lights) = (set(&[(1, 0.0), (3, 40.0)]), set(&[(1, 0.0), (4, 35.0), (5, 70.0)]));
    let meta = BtfMeta { width, height, views, lights, encoding, cosine, sample_type };
    let mut values = Vec::new();
    for (wo, wi) in meta.views.directions().iter().flat_map(|v| meta.lights.directions().iter().map(move |l| (*v, *l)))
    {
        for i in 0..meta.image_len() {
            let (texel, channel) = (i / 3, (i % 3) as f32);
            let kind = (texel * 7 % 5) as f32;
            let gloss = (wi + wo).normalize().z.powf(5.0 + 3.0 * kind);
            let value = wi.z * (0.25 + 0.05 * kind + 0.04 * channel) + 0.4 * gloss + 0.05 * (texel as f32).sin();
            values.push(value.clamp(0.01, 0.98));
        }
    }
    let texels = match sample_type {
        SampleType::U8 => Texels::U8(values.iter().map(|v| (v * 255.0) as u8).collect()),
        _ => Texels::F32(values.into()),
    };
    MemoryBtf::new(meta, texels).unwrap()
}

/// The words of a parameter, or none if the codec does not have it.
fn words(codec: &dyn Codec, name: &str) -> Vec<Option<&'static str>> {
    match codec.params().iter().find(|param| param.name == name).map(|param| param.kind) {
        Some(Kind::Choice(words)) => words.iter().copied().map(Some).collect(),
        _ => vec![None],
    }
}

/// Parameters for few components and clusters, and those that are given.
fn params(codec: &dyn Codec, given: &[(&str, Option<&'static str>)]) -> Values {
    let few = [("components", "3"), ("chroma", "2"), ("clusters", "4"), ("resolution", "3"), ("samples", "20")];
    let known = |(name, _): &(&str, &str)| codec.params().iter().any(|param| param.name == *name);
    let given = given.iter().filter_map(|(name, word)| Some((*name, (*word)?)));
    Values::new(codec.params(), few.into_iter().filter(known).chain(given)).unwrap()
}

/// Every codec in every precision and domain it has.
fn cases() -> Vec<(&'static dyn Codec, Values)> {
    let mut cases = Vec::new();
    for codec in CODECS {
        for precision in words(*codec, "precision") {
            for domain in words(*codec, "domain") {
                cases.push((*codec, params(*codec, &[("precision", precision), ("domain", domain)])));
            }
        }
    }
    cases
}

fn direction(i: usize) -> Vec3 {
    let i = i as f32;
    // one in nine is below the surface
    from_angles(if i % 9.0 == 8.0 { 1.7 } else { (i * 0.377).fract() * 1.55 }, i * 2.4)
}

fn uv(i: usize) -> Vec2 {
    Vec2::new(i as f32 * 0.618, 1.0 - i as f32 * 0.414)
}

/// Fast decoders add up in single precision, the interpreter in double: values differ by their rounding, which the steep
/// end of an encoding near black magnifies by up to 13.
const ROUNDING: f32 = 3e-5;

/// Coefficients of `klt` are evaluated as 16-bit fractions.
const FIXED_POINT: f32 = 4e-3;

fn same(fast: &Decoded, slow: &Decoded, tolerance: f32, about: &str) {
    let meta = fast.meta();
    for view in 0..meta.views.len() {
        let (a, b) = (fast.view(view).unwrap(), slow.view(view).unwrap());
        for (i, (a, b)) in a.to_f32().iter().zip(b.to_f32().iter()).enumerate() {
            assert!((a - b).abs() < ROUNDING * b.abs().max(1.0), "{about} view {view} number {i}: {a} {b}");
        }
        let image = fast.image(view, 3).unwrap();
        assert!(*image.to_f32() == a.to_f32()[3 * meta.image_len()..4 * meta.image_len()], "{about}");
    }
    for scheme in [Scheme::Triangles, Scheme::Rings] {
        let (fast, slow) = (fast.material(scheme).unwrap(), slow.material(scheme).unwrap());
        let mut seen = 0;
        for i in 0..200 {
            let (uv, wi, wo) = (uv(i), direction(i), direction(7 * i + 3));
            let (a, b) = (fast.apparent(uv, wi, wo), slow.apparent(uv, wi, wo));
            let bound = tolerance * b.abs().max_element().max(1.0);
            assert!((a - b).abs().max_element() < bound, "{about} {scheme:?} {i}: {a} {b}");
            assert!(b == Vec3::ZERO || wi.z > 0.0 && wo.z > 0.0, "{about} {scheme:?} {i}: light from below");
            seen += usize::from(b.max_element() > 0.01);
        }
        assert!(seen > 100, "{about} {scheme:?}: only {seen} values are not black");
    }
}

#[test]
fn fast_decoders_and_materials_are_the_interpreter() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    let sources = [
        source(SampleType::U8, Encoding::Srgb, Cosine::Included),
        source(SampleType::F32, Encoding::Linear, Cosine::Excluded),
    ];
    for (codec, params) in cases() {
        for source in &sources {
            codec.encode(source, &params, &path, &Silent).unwrap();
            let btf = codec::open(&path).unwrap();
            let slow = Decoded::interpreted(btf.parts().clone()).unwrap();
            let text: Vec<_> = params.iter().collect();
            let about = format!("{} {:?} {text:?}", codec.name(), source.meta().sample_type);
            let tolerance = if codec.name() == "klt" { FIXED_POINT } else { ROUNDING };
            same(btf.decoded(), &slow, tolerance, &about);
            // the parts alone are enough for a fast decoder
            let copy = MemoryParts::copy(&**btf.parts()).unwrap();
            same(&Decoded::new(Arc::new(copy)).unwrap(), &slow, ROUNDING, &about);
        }
    }
}

fn compress(codec: &dyn Codec, params: &Values, source: &MemoryBtf, lossless: Option<&str>, path: &Path) {
    let lossless = lossless.map(|name| codec::lossless::by_name(name).unwrap());
    let finish = Finish { measure: true, lossless };
    codec::compress(codec, source, params, Goal::Params, finish, path, &Silent).unwrap();
}

#[test]
fn parts_are_stored_and_written_as_files_and_come_back() {
    let temporary = tempfile::tempdir().unwrap();
    let [path, again, parts] = ["x.loden", "again.loden", "parts"].map(|name| temporary.path().join(name));
    let source = source(SampleType::U8, Encoding::Srgb, Cosine::Included);
    for (i, (codec, params)) in cases().into_iter().enumerate() {
        let about = format!("{} {:?}", codec.name(), params.iter().collect::<Vec<_>>());
        compress(codec, &params, &source, [None, Some("zstd")][i % 2], &path);
        let btf = codec::open(&path).unwrap();
        let from = btf.provenance().unwrap();
        let files = folder::write(&**btf.parts(), &from, &parts).unwrap();
        assert_eq!(files, fs::read_dir(&parts).unwrap().count(), "{about}");
        let (read, said) = folder::read_folder(&parts).unwrap();
        assert_eq!(said, from, "{about}");
        assert!(read == MemoryParts::copy(&read).unwrap());
        for parts in [&**btf.parts(), &read as &dyn Parts] {
            let bytes = store(parts, &from, &again).unwrap();
            assert_eq!(bytes, fs::metadata(&again).unwrap().len());
            if codec.decoder().is_none() {
                assert!(fs::read(&path).unwrap() == fs::read(&again).unwrap(), "{about}: another file");
            } else {
                let stored = codec::open(&again).unwrap();
                assert_eq!((stored.method(), stored.error()), ("parts", btf.error()));
                same(stored.decoded(), &Decoded::interpreted(btf.parts().clone()).unwrap(), ROUNDING, &about);
            }
        }
        fs::remove_dir_all(&parts).unwrap();
    }
}

#[test]
fn one_material_wears_the_tables_of_another() {
    let temporary = tempfile::tempdir().unwrap();
    let path = |name: &str| temporary.path().join(name);
    let texels = source(SampleType::U8, Encoding::Srgb, Cosine::Included);
    // half as bright
    let dark: Vec<u8> = (0..texels.meta().views.len())
        .flat_map(|view| texels.view(view).unwrap().to_f32().iter().map(|v| (v * 127.0) as u8).collect::<Vec<_>>())
        .collect();
    let dark = MemoryBtf::new(texels.meta().clone(), Texels::U8(dark.into())).unwrap();
    for name in ["kmeans", "cmf", "pvmf", "pca", "pcmf"] {
        let codec = codec::by_name(name).unwrap();
        let params = params(codec, &[]);
        compress(codec, &params, &texels, None, &path("a.loden"));
        compress(codec, &params, &dark, None, &path("b.loden"));
        let [a, b] = ["a.loden", "b.loden"].map(|name| codec::open(path(name)).unwrap());
        let mut parts = MemoryParts::copy(&**a.parts()).unwrap();
        for table in 0..b.parts().recipe().tables.len() {
            parts.set_table(table, b.parts().table(table).unwrap()).unwrap();
        }
        let from = a.provenance().unwrap();
        store(&parts, &from, &path("c.loden")).unwrap();
        let c = codec::open(path("c.loden")).unwrap();
        assert_eq!(c.method(), name);
        assert!(a.error().is_some() && c.error().is_none(), "{name}: the error is that of other parts");
        let mean = |btf: &dyn BtfSource| {
            let values = btf.view(0).unwrap().to_f32().into_owned();
            values.iter().sum::<f32>() / values.len() as f32
        };
        assert!(mean(&*c) < 0.8 * mean(&*a), "{name}: {} {}", mean(&*c), mean(&*a));
        let slow = Decoded::interpreted(Arc::new(parts)).unwrap();
        same(c.decoded(), &slow, ROUNDING, name);
        // and on an object
        let [bright, dark, slow] = [a.decoded(), c.decoded(), &slow].map(rendered);
        assert!(brightness(&dark) < 0.9 * brightness(&bright), "{name}");
        assert!((brightness(&dark) - brightness(&slow)).abs() < 1e-3, "{name}");
    }
}

fn rendered(parts: &Decoded) -> Picture {
    let material = parts.material(Scheme::Triangles).unwrap();
    let scene = Studio {
        object: &object::load("sphere").unwrap(),
        material: &*material,
        material_name: "parts",
        texture: TextureMap::default(),
        lighting: Lighting::Key { theta_degrees: 40.0, phi_degrees: 120.0 },
    };
    studio(&scene, &Settings { width: 24, height: 18, spp: 4, ..Settings::default() }, &Silent).unwrap()
}

fn brightness(picture: &Picture) -> f32 {
    picture.rgb.iter().map(|rgb| rgb.element_sum()).sum::<f32>() / (3 * picture.rgb.len()) as f32
}

#[test]
fn planes_are_rearranged_to_another_size() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("x.loden");
    let codec = codec::by_name("pcmf").unwrap();
    codec
        .encode(&source(SampleType::U8, Encoding::Srgb, Cosine::Included), &params(codec, &[]), &path, &Silent)
        .unwrap();
    let btf = codec::open(&path).unwrap();
    let [width, height] = SIZE;
    // every texel twice beside itself, upside down
    let meta = BtfMeta { width: 2 * width, ..btf.meta().clone() };
    let texel = |i: usize| (height - 1 - i / (2 * width)) * width + i % (2 * width) / 2;
    let planes = btf.parts().recipe().planes.iter().enumerate().map(|(plane, spec)| {
        let rearranged = (0..meta.texels()).map(|i| {
            let (x, y) = (texel(i) % width, texel(i) / width);
            btf.parts().plane(plane, 0, Rect { x, y, width: 1, height: 1 }).unwrap()
        });
        let numbers = Numbers::concat(&rearranged.collect::<Vec<_>>()).unwrap();
        assert_eq!(numbers.len(), meta.texels() * spec.count());
        numbers
    });
    let tables = (0..btf.parts().recipe().tables.len()).map(|table| btf.parts().table(table).unwrap()).collect();
    let parts = MemoryParts::new(meta.clone(), btf.parts().recipe().clone(), planes.collect(), tables).unwrap();
    store(&parts, &btf.provenance().unwrap(), &path).unwrap();
    let large = codec::open(&path).unwrap();
    let (before, after) = (btf.image(1, 2).unwrap(), large.image(1, 2).unwrap());
    for i in 0..meta.texels() {
        assert_eq!(after.to_f32()[3 * i..3 * i + 3], before.to_f32()[3 * texel(i)..3 * texel(i) + 3]);
    }
}

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
        if let loden::codec::parts::PlaneKind::Numbers { range, .. } = &mut brightness.kind {
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
fn a_damaged_folder_is_named_with_file_and_field() {
    let temporary = tempfile::tempdir().unwrap();
    let [path, parts] = ["x.loden", "parts"].map(|name| temporary.path().join(name));
    let codec = codec::by_name("pcmf").unwrap();
    let source = source(SampleType::U8, Encoding::Srgb, Cosine::Included);
    compress(codec, &params(codec, &[]), &source, None, &path);
    let btf = codec::open(&path).unwrap();
    let write = || {
        let _ = fs::remove_dir_all(&parts);
        folder::write(&**btf.parts(), &btf.provenance().unwrap(), &parts).unwrap();
    };
    let text = |from: &str, to: &str| {
        let file = parts.join(folder::MANIFEST);
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.contains(from), "{from}");
        fs::write(file, text.replace(from, to)).unwrap();
    };
    type Damage<'a> = (&'a str, &'a str, Box<dyn Fn() + 'a>);
    let damages: Vec<Damage> = vec![
        ("index.png", "", Box::new(|| fs::remove_file(parts.join("index.png")).unwrap())),
        ("coefficients.exr", "", Box::new(|| fs::remove_file(parts.join("coefficients.exr")).unwrap())),
        ("coefficients.exr", "EXR", Box::new(|| fs::write(parts.join("coefficients.exr"), b"no").unwrap())),
        ("block.npy", "magic", Box::new(|| fs::write(parts.join("block.npy"), b"no").unwrap())),
        (
            "block.npy",
            "header",
            Box::new(|| {
                fs::copy(parts.join("components.npy"), parts.join("block.npy")).unwrap();
            }),
        ),
        (
            "block.npy",
            "data",
            Box::new(|| {
                let bytes = fs::read(parts.join("block.npy")).unwrap();
                fs::write(parts.join("block.npy"), &bytes[..bytes.len() - 2]).unwrap();
            }),
        ),
        (
            "block.npy",
            "not finite",
            Box::new(|| {
                let mut bytes = fs::read(parts.join("block.npy")).unwrap();
                let end = bytes.len();
                bytes[end - 2..].copy_from_slice(&half::f16::NAN.to_le_bytes());
                fs::write(parts.join("block.npy"), bytes).unwrap();
            }),
        ),
        ("index.png", "expected 8 x 5", Box::new(|| text("\"width\": 7", "\"width\": 8"))),
        ("recipe.json", "width", Box::new(|| text("\"width\": 7", "\"width\": 0"))),
        ("recipe.json", "JSON", Box::new(|| text("\"planes\"", "\"plains\""))),
        ("recipe.json", "version \"2\"", Box::new(|| text("\"loden\": \"1\"", "\"loden\": \"2\""))),
        ("recipe.json", "recipe.planes", Box::new(|| text("\"name\": \"index\"", "\"name\": \"../index\""))),
        ("recipe.json", "recipe.value.sum[0].table.row", Box::new(|| text("\"rows\": 4", "\"rows\": 5"))),
        (
            "index.png",
            "row",
            Box::new(|| {
                let grey = image::GrayImage::from_pixel(7, 5, image::Luma([4]));
                grey.save(parts.join("index.png")).unwrap();
            }),
        ),
        (
            "index.png",
            "grey",
            Box::new(|| {
                image::RgbImage::new(7, 5).save(parts.join("index.png")).unwrap();
            }),
        ),
    ];
    for (file, field, damage) in damages {
        write();
        damage();
        let error = folder::read_folder(&parts).map(drop).unwrap_err().to_string();
        assert!(error.contains(file) && error.contains(field), "{file} {field}: {error}");
    }
    // a folder in use is left alone
    write();
    assert!(folder::write(&**btf.parts(), &btf.provenance().unwrap(), &parts).is_err());
}

#[test]
fn recipes_are_checked_field_by_field() {
    let meta = source(SampleType::U8, Encoding::Srgb, Cosine::Included).meta().clone();
    let codec = codec::by_name("pcmf").unwrap();
    let good = codec.recipe(&meta, &params(codec, &[])).unwrap();
    good.check(&meta).unwrap();
    type Change = (&'static str, fn(&mut Recipe));
    let changes: [Change; 14] = [
        ("recipe.value.sum[1].dot.table: found 7", |r| r.value = changed(&r.value, |dot| dot.1 = 7)),
        ("recipe.value.sum[1].dot.plane: found 7", |r| r.value = changed(&r.value, |dot| dot.0 = 7)),
        ("recipe.value.sum[1].dot.row: found 7", |r| r.value = changed(&r.value, |dot| dot.2 = Some(7))),
        ("components has rows", |r| r.value = changed(&r.value, |dot| dot.2 = None)),
        ("index is an index plane", |r| r.value = changed(&r.value, |dot| dot.0 = 0)),
        ("plane 1 is not an index plane", |r| r.value = changed(&r.value, |dot| dot.2 = Some(1))),
        ("coefficients does not occur", |r| r.value = Expr::Table { table: 0, row: Some(0) }),
        ("recipe.value.sum: it is empty", |r| r.value = Expr::Sum(Vec::new())),
        ("nested deeper", |r| (0..20).for_each(|_| r.value = Expr::Sum(vec![r.value.clone()]))),
        ("occurs twice", |r| r.tables[0].axes.push(Axis::View)),
        ("the name \"block\" occurs twice", |r| r.tables[1].name = "block".into()),
        ("has 3 components, but coefficients has 4 numbers", |r| {
            r.planes[1] = PlaneSpec::numbers("coefficients", 4, SampleType::F16);
        }),
        ("expected 1 to", |r| r.tables[1].axes[1] = Axis::Component(usize::MAX)),
        ("recipe.tables.block.range", |r| r.tables[0].range = Some(1)),
    ];
    for (expected, change) in changes {
        let mut recipe = good.clone();
        change(&mut recipe);
        let error = recipe.check(&meta).unwrap_err().to_string();
        assert!(error.contains(expected), "{expected}: {error}");
    }
    // what a file or a folder holds is text
    let text = serde_json::to_string(&good).unwrap();
    assert_eq!(serde_json::from_str::<Recipe>(&text).unwrap(), good);
}

/// A sum whose second term is a dot product: (plane, table, row) changed.
fn changed(value: &Expr, change: fn(&mut (usize, usize, Option<usize>))) -> Expr {
    let Expr::Sum(terms) = value else { panic!("a sum") };
    let Expr::Dot { plane, table, row } = terms[1] else { panic!("a dot product") };
    let mut dot = (plane, table, row);
    change(&mut dot);
    Expr::Sum(vec![terms[0].clone(), Expr::Dot { plane: dot.0, table: dot.1, row: dot.2 }])
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
    let from =
        Provenance::unknown(codec::container::SourceInfo { bytes: 0, sample_type: SampleType::U8, missing: vec![] });
    store(&parts, &from, &path).unwrap();
    let found = codec::open(&path).unwrap().image(0, 0).unwrap().to_f32().into_owned();
    assert!(found.iter().all(|v| (v - 0.5).abs() < 1e-6));
}
