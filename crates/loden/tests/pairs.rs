//! BTFs with their own list of pairs: read, compressed, evaluated, compared, and written.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use glam::Vec2;
use loden::btf::{BtfMeta, BtfSource, Cosine, MemoryBtf, SampleType, Texels};
use loden::codec::{self, Finish, Goal};
use loden::color::Encoding;
use loden::direction::{DirectionSet, Scheme};
use loden::material::{Material, PagedBtf, RawBtf};
use loden::params::{Given, Values};
use loden::progress::Silent;
use loden::{export, import, metric};

const SIZE: [usize; 2] = [4, 3];

/// Forty pairs of directions, of which no two have the same light or view.
fn degrees() -> Vec<[f64; 4]> {
    let angle = |i: usize, step: f64, most: f64| ((i as f64 * step).fract() * most * 10.0).round() / 10.0;
    let pair = |i| [angle(i, 0.618, 75.0), angle(i, 0.755, 360.0), angle(i, 0.57, 70.0), angle(i, 0.349, 360.0)];
    (1..=40).map(pair).collect()
}

/// A glossy material of different colours.
fn btf(encoding: Encoding, cosine: Cosine) -> MemoryBtf {
    let (views, lights) = (DirectionSet::normal(), DirectionSet::of_pairs(&degrees()).unwrap());
    let [width, height] = SIZE;
    let meta = BtfMeta { width, height, views, lights, encoding, cosine, sample_type: SampleType::F32 };
    let mut values = Vec::new();
    for light in 0..meta.lights.len() {
        let (wi, wo) = meta.pair(0, light);
        let gloss = 0.3 * (wi + wo).normalize().z.powi(20);
        let stored = if cosine == Cosine::Included { wi.z } else { 1.0 };
        values.extend((0..meta.image_len()).map(|i| encoding.encode(stored * (0.1 + 0.02 * i as f32 + gloss))));
    }
    MemoryBtf::new(meta, Texels::F32(values.into())).unwrap()
}

/// The largest difference between evaluation at the measured pairs and at the centres of texels from the apparent values there.
fn off_at_pairs(material: &dyn Material, source: &dyn BtfSource) -> f32 {
    let meta = source.meta();
    let mut most = 0.0f32;
    for light in 0..meta.lights.len() {
        let (wi, wo) = meta.pair(0, light);
        let image = source.image(0, light).unwrap().to_f32().into_owned();
        let factor = if meta.cosine == Cosine::Included { 1.0 } else { wi.z };
        for (texel, rgb) in image.as_chunks::<3>().0.iter().enumerate() {
            let uv = |i: usize, size: usize| (i as f32 + 0.5) / size as f32;
            let at = Vec2::new(uv(texel % meta.width, meta.width), 1.0 - uv(texel / meta.width, meta.height));
            let expected = rgb.map(|v| meta.encoding.decode(v) * factor);
            let found = material.apparent(at, wi, wo).to_array();
            most = expected.iter().zip(found).fold(most, |most, (a, b)| most.max((a - b).abs()));
        }
    }
    most
}

#[test]
fn methods_keep_the_list_and_evaluate_its_pairs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.loden");
    let most = |name: &str| if name == "klt" { 0.05 } else { 0.02 };
    for (encoding, cosine) in [(Encoding::Linear, Cosine::Excluded), (Encoding::Srgb, Cosine::Included)] {
        let source = btf(encoding, cosine);
        for (name, given) in [
            ("pvmf", [("components", "9")]),
            ("pca", [("components", "9")]),
            ("svd", [("components", "9")]),
            ("klt", [("step", "0.5")]),
            ("kmeans", [("clusters", "12")]),
            ("dfmf", [("components", "9")]),
        ] {
            let codec = codec::by_name(name).unwrap();
            let given = given.into_iter().filter(|(name, _)| codec.params().iter().any(|param| param.name == *name));
            let params = Values::new(codec.params(), given).unwrap();
            let finish = Finish { measure: true, lossless: None };
            let done = codec::compress(codec, &source, &params, Goal::Params, finish, &path, &Silent).unwrap();
            let opened = codec::open(&path).unwrap();
            assert_eq!(opened.meta().lights, source.meta().lights, "{name}");
            let report = metric::compare(&source, &*opened, &Silent).unwrap();
            assert!((report.mean_abs_error - done.error.unwrap().mean_abs_error).abs() < 1e-9, "{name}");
            assert!(report.mean_abs_error < 0.02, "{name}: {report:?}");
            let material = opened.material(Scheme::Triangles).unwrap();
            let (off, error) = (off_at_pairs(&*material, &source), off_at_pairs(&*material, &*opened));
            assert!(error < 1e-3, "{name} {encoding}: evaluation differs from decoded images by {error}");
            assert!(off < most(name), "{name} {encoding}: {off}");
        }
    }
}

#[test]
fn images_are_exact_at_their_pairs_in_memory_and_paged() {
    let source = btf(Encoding::Srgb, Cosine::Included);
    let raw = RawBtf::new(&source as &dyn BtfSource, Scheme::Triangles).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let memory = "1M".parse().unwrap();
    let paged = PagedBtf::new(&source, Scheme::Triangles, memory, folder.path(), &Silent).unwrap();
    assert!(off_at_pairs(&raw, &source) < 1e-4);
    assert!(off_at_pairs(&paged, &source) < 1e-4);
    for i in 0..200 {
        let w = |x: f32| loden::direction::from_angles((x * 0.61).sin().abs() * 1.5, x);
        let (uv, wi, wo) = (Vec2::new(0.13 * i as f32, 0.29), w(i as f32), w(i as f32 + 0.3));
        let value = raw.apparent(uv, wi, wo);
        assert_eq!(value, paged.apparent(uv, wi, wo));
        assert!(value.is_finite() && value.min_element() >= 0.0 && value.max_element() < 1.0, "{value}");
        // a direction that is drawn has the density that is stated
        if let Some(sample) = raw.sample(uv, wo, Vec2::new(0.3, 0.007 * (i % 100) as f32)) {
            assert!((raw.pdf(uv, sample.wi, wo) - sample.pdf).abs() <= 1e-3 * sample.pdf, "{sample:?}");
        }
    }
}

#[test]
fn a_raw_array_brings_the_list_back() {
    let folder = tempfile::tempdir().unwrap();
    let (path, source) = (folder.path().join("set.toml"), btf(Encoding::Linear, Cosine::Included));
    export::export(&source, &path, &Given::default(), &Silent).unwrap();
    let back = import::open(&path, &Default::default()).unwrap();
    assert_eq!(back.meta(), source.meta());
    assert_eq!(metric::compare(&source, &*back, &Silent).unwrap().max_abs_error, 0.0);
    // pairs have no views beside them
    let numbers = fs::read(path.with_extension("f32")).unwrap();
    fs::write(path.with_extension("f32"), numbers.repeat(2)).unwrap();
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replace("[[0.0, 0.0]]", "[[0.0, 0.0], [5.0, 0.0]]").replace("shape = [1", "shape = [2"))
        .unwrap();
    let error = import::open(&path, &Default::default()).err().unwrap().to_string();
    assert!(error.contains("set.toml: views: found 2 directions, expected 1 beside a list of pairs"), "{error}");
}

#[test]
fn formats_of_full_grids_refuse_a_list() {
    let folder = tempfile::tempdir().unwrap();
    let source = btf(Encoding::Linear, Cosine::Included);
    for name in ["x.zip", "x.btf"] {
        let path = folder.path().join(name);
        let error = export::export(&source, &path, &Given::default(), &Silent).unwrap_err().to_string();
        assert!(error.contains("needs every view with every light"), "{name}: {error}");
        assert!(!path.exists());
    }
    let codec = codec::by_name("cmf").unwrap();
    let params = Values::new(codec.params(), []).unwrap();
    let (finish, path) = (Finish { measure: true, lossless: None }, folder.path().join("x.loden"));
    let error = codec::compress(codec, &source, &params, Goal::Params, finish, &path, &Silent).unwrap_err().to_string();
    assert!(error.contains("cmf needs every view with every light; this BTF has its own list of 40 pairs"), "{error}");
}

/// Pictures of the BTF, named by their position in the list.
fn pictures(folder: &Path) {
    let source = btf(Encoding::Srgb, Cosine::Included);
    for light in 0..source.meta().lights.len() {
        let bytes = source.image(0, light).unwrap().to_f32().iter().map(|v| (255.0 * v).round() as u8).collect();
        let picture = image::RgbImage::from_raw(SIZE[0] as u32, SIZE[1] as u32, bytes).unwrap();
        picture.save(folder.join(format!("shot{:02}.png", light + 1))).unwrap();
    }
}

fn opened(path: &Path, text: &str, given: &Given) -> loden::Result<Arc<dyn BtfSource>> {
    fs::write(path, format!("loden_images = 1\nfiles = \"shot{{pair}}.png\"\ncount_from = 1\n{text}\n")).unwrap();
    import::open(path, given)
}

#[test]
fn pictures_are_listed_by_a_manifest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("set.toml");
    pictures(folder.path());
    let list = format!("pairs = {:?}", degrees());
    let source = opened(&path, &list, &Given::default()).unwrap();
    assert_eq!(source.meta().lights, DirectionSet::of_pairs(&degrees()).unwrap());
    let report = metric::compare(&btf(Encoding::Srgb, Cosine::Included), &*source, &Silent).unwrap();
    assert!(report.max_abs_error <= 0.5001 / 255.0, "{report:?}");
    assert_eq!(source.meta().raw8_bytes(), 40 * 3 * 12);
    // pairs without a picture are left out and reported
    fs::remove_file(folder.path().join("shot03.png")).unwrap();
    let source = opened(&path, &list, &Given::default()).unwrap();
    assert_eq!(source.meta().lights.len(), 39);
    assert_eq!(source.warnings(), ["1 of 40 listed pairs have no picture and are left out"]);
    for (text, expected) in [
        ("", "pairs: the list is missing, but `files` has {pair}"),
        ("pairs = [[0, 0], [10, 0]]", "pairs: found two numbers per pair, expected four"),
        ("pairs = [[0, 0, 0, 0]]\nviews = [[0, 0]]", "pairs: found views or lights beside the list"),
        ("lights = [[0, 0, 0, 0]]", "lights: found four numbers per direction, expected two"),
        ("pairs = [[0, 0, 0, 0], [10, 0, 10, 0]]", "pairs: shot04.png has the number 4, but there are 2 directions"),
        ("pairs = [[0, 0, 95, 0]]", "line 4: directions: found (95, 0), expected a polar angle in 0..=90"),
        ("pairs = [[0, 0, 0]]", "line 4: "),
        ("pairs = []", "line 4: directions: the list is empty"),
    ] {
        let error = opened(&path, text, &Given::default()).err().unwrap().to_string();
        assert!(error.contains("set.toml: ") && error.contains(expected), "{text}: {error}");
    }
}

#[test]
fn a_sparse_grid_becomes_a_list_unless_it_is_to_be_completed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("set.toml");
    for (view, light) in [(0, 0), (1, 2), (2, 1)] {
        let grey = image::RgbImage::from_pixel(2, 2, image::Rgb([60 * view as u8 + 10 * light as u8; 3]));
        grey.save(folder.path().join(format!("v{view}l{light}.png"))).unwrap();
    }
    let text = "loden_images = 1\nfiles = \"v{view}l{light}.png\"\nviews = [[0, 0], [30, 0], [40, 90]]\n\
                lights = [[10, 0], [50, 0], [60, 180]]\n";
    fs::write(&path, text).unwrap();
    let listed = import::open(&path, &Default::default()).unwrap();
    let meta = listed.meta();
    assert_eq!((meta.is_listed(), meta.pairs(), listed.missing().len()), (true, 3, 0));
    assert_eq!(meta.pair_degrees(0, 1), [[60.0, 180.0], [30.0, 0.0]]);
    assert_eq!(listed.image(0, 1).unwrap().to_f32()[0], 80.0 / 255.0);
    let complete = import::open(&path, &Given::default().with("complete", "yes")).unwrap();
    assert_eq!((complete.meta().is_listed(), complete.meta().pairs(), complete.missing().len()), (false, 9, 6));
    // two lists of different pairs cannot be compared, nor a list and a grid
    let error = metric::compare(&*listed, &*complete, &Silent).unwrap_err().to_string();
    assert!(error.contains("pairs"), "{error}");
}
