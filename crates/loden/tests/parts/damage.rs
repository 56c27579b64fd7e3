//! Damaged folders and recipes that contradict themselves.

use std::fs;

use loden::btf::{BtfSource, Cosine, SampleType};
use loden::codec;
use loden::codec::parts::{Axis, Expr, PlaneSpec, Recipe, folder};
use loden::color::Encoding;

use super::{compress, params, source};

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
        ("recipe.json", "version \"9\"", Box::new(|| text("\"loden\": \"2\"", "\"loden\": \"9\""))),
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
