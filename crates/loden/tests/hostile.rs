//! Importers never trust a file: truncated, padded, byte-flipped and inconsistent files are errors or are read, and
//! never panic.

use std::fs;
use std::path::Path;

use crate::common::tensor::{self, floats};
use crate::common::{Synthetic, data};
use glam::Vec2;
use loden::btf::{BtfMeta, BtfSource, Origin, Rect};
use loden::direction::{DirectionSet, from_angles};
use loden::export;
use loden::import::{self, IMPORTERS};
use loden::model::Lambert;
use loden::params::Given;
use loden::progress::Silent;

/// Formats whose tables are slow to prepare: fewer damaged variants.
const SLOW: [&str; 4] = ["i.dat", "m.mit", "o.bsdf", "q.png"];

/// The path that is opened to read a file: the file, or the folder of a photograph or of a carrier's picture.
fn measurement(path: &Path) -> &Path {
    if path.extension().is_some_and(|e| e == "bmp" || e == "tif") { path.parent().unwrap() } else { path }
}

/// Opens a file and reads its values.
fn read(path: &Path) -> loden::Result<()> {
    match import::open_named(measurement(path), &Default::default())?.1.images() {
        Ok(source) => {
            let meta: &BtfMeta = source.meta();
            if meta.image_len() < 1 << 20 {
                let image = source.image(meta.views.len() - 1, 0)?;
                assert_eq!(image.len(), meta.image_len());
            }
        }
        Err(brdf) => {
            let (wi, wo) = (from_angles(0.4, 1.0), from_angles(1.2, 4.0));
            assert!(!brdf.eval(Vec2::ZERO, wi, wo).is_nan());
            let _ = brdf.sample(Vec2::ZERO, wo, Vec2::new(0.3, 0.7));
            let _ = brdf.spectrum(wi, wo);
        }
    }
    Ok(())
}

/// A small valid file for each format that can be written, with its companion files.
fn whole_files(folder: &Path) -> Vec<String> {
    let mut source = Synthetic::bonn81(3, 2);
    source.meta.views = DirectionSet::from_degrees(vec![[0.0, 0.0], [30.0, 0.0]]).unwrap();
    source.meta.lights = DirectionSet::from_degrees(vec![[0.0, 0.0], [30.0, 0.0], [60.0, 90.0]]).unwrap();
    let few = Given::from([("png", "yes"), ("components", "4")]);
    for (name, format) in
        [("a.zip", "ubo2003"), ("b.toml", "raw"), ("c.btf", "dfmf"), ("d.btf", "fmf"), ("e.btf", "bdi")]
    {
        let path = folder.join(name);
        let exporter = export::by_name(&path, Some(format)).unwrap();
        export::export_as(exporter, &source, &path, &few.split(exporter.params()).0, &Silent).unwrap();
    }
    let codec = loden::codec::by_name("pvmf").unwrap();
    let values = loden::params::Values::new(codec.params(), [("components", "2")]).unwrap();
    codec.encode(&source as &dyn BtfSource, &values, &folder.join("f.loden"), &Silent).unwrap();
    image::RgbImage::new(2, 2).save(folder.join("p1.png")).unwrap();
    let reflectances: String = (0..205).map(|i| format!(" {}", i as f32 * 0.01)).collect();
    let table: String = (1..=205).map(|i| format!("{i} 0.5 {} 0.4 0\n", i as f32 * 0.03)).collect();
    let rows: String = (0..20).map(|i| format!("0.{i:02} 0 0.3 {} 0.5 0.25\n", i as f32 * 0.1)).collect();
    let vars = "VARS theta_i,phi_i,theta_s,phi_s,R,G,B";
    for (name, text) in [
        ("g.brdf", format!("2\n500 600\n{rows}")),
        ("h.astm", format!("NUM_POINTS 1\n{vars}\n\n0.1,0,0.2,1,0.5,0.5,0.5\n")),
        ("i.dat", format!("1{reflectances}\n2{reflectances}\n")),
        ("table.txt", table),
        ("j.alta", "#DIM 3 1\n#PARAM_IN RUSIN_TH_TD_PD\n0.1 0.2 0.3 1.0\n0.2 0.2 0.3 0.5\n".into()),
        ("k.lp", "1\np1.png 0 0.6 0.8\n".into()),
        ("l.toml", "loden_images = 1\nfiles = \"p{light}.png\"\ncount_from = 1\n".into()),
    ] {
        fs::write(folder.join(name), text).unwrap();
    }
    let mut mit = [0i32; 16];
    (mit[0], mit[1], mit[2], mit[3], mit[6], mit[10]) = (2, 2, 4, 4, 1, 3);
    let floats = (0..64 * 3).flat_map(|i| (i as f32 * 0.01).to_le_bytes());
    fs::write(folder.join("m.mit"), mit.iter().flat_map(|v| v.to_le_bytes()).chain(floats).collect::<Vec<u8>>())
        .unwrap();
    let merl = [2i32, 2, 2].iter().flat_map(|v| v.to_le_bytes());
    let merl = merl.chain((0..24).flat_map(|i| f64::from(i).to_le_bytes()));
    fs::write(folder.join("n.binary"), merl.collect::<Vec<u8>>()).unwrap();
    let grey = Lambert { albedo: glam::Vec3::splat(0.5) };
    export::export_brdf(&grey, &[], &folder.join("o.bsdf"), &Given::default()).unwrap();
    fs::write(folder.join("p.pbsdf"), pbsdf()).unwrap();
    image::RgbImage::new(288, 288).save(folder.join("q.png")).unwrap();
    fs::create_dir(folder.join("sample07")).unwrap();
    image::RgbImage::new(3, 2).save(folder.join("sample07/07-001.bmp")).unwrap();
    let method = loden::separable::by_name("nd").unwrap();
    let size = loden::params::Values::new(method.params(), [("resolution", "4")]).unwrap();
    let factored = method.factor(&grey, &size, &Silent).unwrap();
    loden::separable::write(&factored, &Default::default(), &folder.join("r.loden")).unwrap();
    let around = [[0.0, 0.0], [60.0, 0.0], [60.0, 90.0], [60.0, 180.0], [60.0, 270.0]];
    source.meta.views = DirectionSet::from_degrees(around.to_vec()).unwrap();
    source.meta.lights = source.meta.views.clone();
    codec.encode(&source as &dyn BtfSource, &values, &folder.join("s.loden"), &Silent).unwrap();
    carrier(&folder.join("s.loden"), &folder.join("carrier"));
    let names = "a.zip b.toml c.btf d.btf e.btf f.loden r.loden g.brdf h.astm i.dat j.alta k.lp l.toml m.mit n.binary o.bsdf p.pbsdf q.png sample07/07-001.bmp carrier/carrier.json carrier/loden_s_view001.tif";
    names.split(' ').map(str::to_owned).collect()
}

/// The export of a compressed material as pictures that carry its numbers, into a new folder.
fn carrier(material: &Path, folder: &Path) {
    fs::create_dir(folder).unwrap();
    let renderer = loden::renderers::by_name("renderman").unwrap();
    let values = Given::from([("textures", "carrier")]).values(renderer.params()).unwrap();
    let renderer = renderer.with(&values).unwrap().unwrap();
    renderer.write("s", &loden::codec::open(material).unwrap(), folder, &Silent).unwrap();
}

/// Mueller matrices of 2 x 2 x 2 nodes and 2 wavelengths.
fn pbsdf() -> Vec<u8> {
    tensor::file(&[
        ("wvls", 3, vec![2], [450u16, 650].iter().flat_map(|v| v.to_le_bytes()).collect()),
        ("phi_d", 10, vec![1, 2], floats(&[0.0, 3.0])),
        ("theta_d", 10, vec![1, 2], floats(&[0.0, 1.5])),
        ("theta_h", 10, vec![0, 2], vec![]),
        ("M", 10, vec![2, 2, 2, 2, 4, 4], floats(&(0..256).map(|i| i as f32 * 0.01).collect::<Vec<_>>())),
    ])
}

#[test]
fn every_importer_survives_damaged_files() {
    let dir = tempfile::tempdir().unwrap();
    let files = whole_files(dir.path());
    let mut seen = std::collections::BTreeSet::new();
    let thorough = std::env::var_os("LODEN_THOROUGH").is_some();
    for name in &files {
        let path = dir.path().join(name);
        let importer =
            import::open_named(measurement(&path), &Default::default()).unwrap_or_else(|e| panic!("{name}: {e}")).0;
        seen.insert(importer.name());
        read(&path).unwrap_or_else(|e| panic!("{name}: {e}"));
        let whole = fs::read(&path).unwrap();
        let expensive = SLOW.contains(&name.as_str());
        let binary = whole.contains(&0) && importer.name() != "utia";
        let attempt = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            read(&path)
        };
        // a TIFF file ends with the place of a further directory, which there is not
        let needed = whole.len() - if name.ends_with(".tif") { 4 } else { 0 };
        let step = |most: usize| whole.len().div_ceil(if expensive { most / 10 } else { most });
        for cut in (0..whole.len()).step_by(step(200)) {
            let result = attempt(&whole[..cut]);
            assert!(
                result.is_err() || !binary || cut >= needed,
                "{name} cut at {cut} of {} is taken as whole",
                whole.len()
            );
            if let Err(error) = result {
                assert!(error.to_string().contains(&dir.path().display().to_string()), "{error}");
            }
        }
        let padded = attempt(&[&whole[..], &[0; 64]].concat());
        if ["c.btf", "d.btf", "e.btf", "m.mit", "n.binary"].contains(&name.as_str()) {
            assert!(padded.is_err(), "{name}: bytes behind the end are taken");
        }
        // damage the header most
        let head = (0..whole.len().min(400)).chain((400..whole.len()).step_by(step(100)));
        for at in head.step_by(if expensive { 7 } else { 1 }) {
            const FLIPS: [u8; 3] = [0x01, 0x80, 0xff];
            for flip in if thorough && !expensive { &FLIPS[..] } else { &FLIPS[at % 3..][..1] } {
                let mut damaged = whole.clone();
                damaged[at] ^= flip;
                let _ = attempt(&damaged);
            }
        }
        fs::write(&path, &whole).unwrap();
    }
    let all: std::collections::BTreeSet<_> = IMPORTERS.iter().map(|i| i.name()).collect();
    assert_eq!(seen, all, "an importer has no file in this test");
}

/// Through JSON, as a path to another process.
#[test]
fn every_measurement_opens_again_from_its_origin() {
    let dir = tempfile::tempdir().unwrap();
    for name in whole_files(dir.path()) {
        let path = measurement(&dir.path().join(&name)).to_owned();
        let importer = import::recognise(&path).unwrap();
        let given = Given::from([("cosine", "excluded"), ("azimuth", "cw"), ("first-row", "top"), ("index", "1")]);
        let options = given.split(importer.params()).0;
        let measured = import::open_named(&path, &options).unwrap().1;
        let origin = match measured.clone().images() {
            Ok(source) => source.origin().unwrap_or_else(|| panic!("{name} has no origin")),
            Err(_) => Origin { path, importer: importer.name().into(), options: options.clone() },
        };
        let origin: Origin = serde_json::from_str(&serde_json::to_string(&origin).unwrap()).unwrap();
        assert!(origin.path.is_absolute() && origin.options == options, "{name}: {origin:?}");
        match (measured.images(), import::reopen(&origin).unwrap().images()) {
            (Ok(a), Ok(b)) => {
                assert_eq!((a.meta(), a.origin()), (b.meta(), b.origin()), "{name}");
                assert_eq!(a.view(0).unwrap(), b.view(0).unwrap(), "{name}");
            }
            (Err(a), Err(b)) => assert_eq!(a.samples().len(), b.samples().len(), "{name}"),
            _ => panic!("{name} is of another kind when it is opened again"),
        }
    }
    let unknown = Origin { path: "x".into(), importer: "y".into(), options: Given::default() };
    assert!(import::reopen(&unknown).err().unwrap().to_string().starts_with("importer: found \"y\", expected one of"));
}

#[test]
fn an_option_that_the_importer_does_not_have_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let _ = whole_files(dir.path());
    let open = |name: &str, option: (&str, &str)| {
        import::open_named(dir.path().join(name), &Given::from([option])).err().unwrap().to_string()
    };
    assert_eq!(open("n.binary", ("azimuth", "cw")), "azimuth: no such parameter; there are none");
    assert!(
        open("c.btf", ("index", "1")).starts_with("index: no such parameter; there are: encoding, cosine, first-row")
    );
    assert!(
        open("a.zip", ("encoding", "sgrb")).starts_with("encoding: found \"sgrb\", expected linear, srgb or gamma")
    );
}

#[test]
fn a_region_is_part_of_the_images() {
    let dir = tempfile::tempdir().unwrap();
    for name in whole_files(dir.path()) {
        let Ok(source) = import::open(measurement(&dir.path().join(&name)), &Given::default()) else { continue };
        let meta = source.meta();
        let (views, lights) = ([meta.views.len() - 1, 0], [meta.lights.len() - 1]);
        let rect = Rect { x: meta.width - 1, y: meta.height / 2, width: 1, height: meta.height - meta.height / 2 };
        let mut out = vec![0.0; 3 * views.len() * lights.len() * rect.texels()];
        source.read(&views, &lights, rect, &mut out).unwrap();
        let images = views.map(|view| source.image(view, lights[0]).unwrap().to_f32().into_owned());
        let texel = |image: &Vec<f32>, y: usize| image[3 * (y * meta.width + rect.x)..][..3].to_vec();
        let expected: Vec<f32> =
            images.iter().flat_map(|image| (rect.y..meta.height).flat_map(move |y| texel(image, y))).collect();
        assert_eq!(out, expected, "{name}");
        for (views, rect, out) in [
            (&[meta.views.len()][..], rect, &mut out[..3 * rect.texels()]),
            (&[0], Rect { x: meta.width, ..rect }, &mut vec![0.0; 3 * rect.texels()][..]),
            (&[0], rect, &mut vec![0.0; 3 * rect.texels() + 1][..]),
        ] {
            assert!(matches!(source.read(views, &[0], rect, out), Err(loden::Error::Parameter { .. })), "{name}");
        }
        source.read(&[], &[0], rect, &mut []).unwrap();
    }
}

#[test]
fn lying_headers_are_refused_without_allocating() {
    let dir = tempfile::tempdir().unwrap();
    let _ = whole_files(dir.path());
    for name in ["c.btf", "d.btf", "e.btf", "m.mit", "n.binary", "o.bsdf", "p.pbsdf"] {
        let path = dir.path().join(name);
        let whole = fs::read(&path).unwrap();
        // set any four bytes of the header to the largest number
        for at in 8..whole.len().min(600) - 8 {
            for lie in [[0xff; 4], [0xff, 0xff, 0xff, 0x7f], [0, 0, 0, 0x10]] {
                let mut damaged = whole.clone();
                damaged[at..at + 4].copy_from_slice(&lie);
                fs::write(&path, &damaged).unwrap();
                if !SLOW.contains(&name) || at % 16 == 0 {
                    let _ = read(&path);
                }
            }
        }
    }
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn every_shared_file_opens() {
    let root = data("");
    let mut opened = 0;
    for (folder, endings) in [
        ("rgl_epfl", &["bsdf"][..]),
        ("cornell_pbrt_v2", &["brdf"]),
        ("cornell_astm", &["astm"]),
        ("curet", &["abrdf.dat"]),
        ("rti_loewenkopf", &["lp"]),
        ("oracle", &["zip", "btf"]),
        ("btf", &["zip"]),
    ] {
        for entry in fs::read_dir(root.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if endings.iter().any(|ending| path.to_string_lossy().ends_with(ending)) {
                read(&path).unwrap_or_else(|e| panic!("{e}"));
                opened += 1;
            }
        }
    }
    println!("{opened} files opened");
    assert_eq!(opened, 17);
}
