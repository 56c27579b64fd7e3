//! New materials from the command line: the files and messages of `loden edit` and `loden generate`.

use std::fs;
use std::path::Path;

use crate::common::{failure, json, workshop};
use serde_json::Value;

fn bytes(at: &Path, file: &str) -> Vec<u8> {
    fs::read(at.join(file)).unwrap()
}

#[test]
fn an_exchange_with_oneself_and_an_edit_by_zero_give_the_same_file() {
    let dir = workshop();
    let at = dir.path();
    for method in ["kmeans --clusters 9", "tsvq --clusters 6 --lossless zstd"] {
        json(at, &format!("compress small.zip --method {method} -o a.loden"));
        for keep in ["nothing", "shading"] {
            json(at, &format!("generate exchange --structure a.loden --reflectance a.loden --keep {keep} -o b.loden"));
            assert!(bytes(at, "a.loden") == bytes(at, "b.loden"), "{method} {keep}");
        }
        json(at, "generate blend a.loden a.loden --amount 0 -o b.loden");
        assert!(bytes(at, "a.loden") == bytes(at, "b.loden"), "{method}");
        json(at, "edit a.loden --recolor hue=0 --gloss 1 -o b.loden");
        assert!(bytes(at, "a.loden") == bytes(at, "b.loden"), "{method}");
    }
}

#[test]
fn edits_are_recorded_and_do_not_depend_on_threads() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --method kmeans --clusters 9 -o a.loden");
    let edit = "edit a.loden --recolor hue=40,saturation=0.5 --gloss 0.8 --contrast 1.3 --rows 0,2-4";
    let done = json(at, &format!("{edit} -o b.loden --threads 1"));
    assert_eq!((&done["rows"][0], &done["edit"]["recolor"]["turn"]["hue"]), (&Value::from(9), &Value::from(40.0)));
    json(at, &format!("{edit} -o c.loden --threads 2"));
    assert!(bytes(at, "b.loden") == bytes(at, "c.loden"));
    json(at, "edit b.loden --exposure 0.5 -o c.loden");
    let history = json(at, "info c.loden")["history"].clone();
    let steps = history.as_array().unwrap();
    assert!(steps.len() == 2 && steps[0].as_str().unwrap().contains("\"saturation\":0.5"), "{history}");
    assert!(json(at, "info a.loden").get("history").is_none());
    // what was done survives parts and packing
    json(at, "decompress c.loden --parts parts");
    json(at, "compress --from-parts parts -o d.loden");
    assert!(bytes(at, "c.loden") == bytes(at, "d.loden"));
}

#[test]
fn materials_without_rows_are_clustered_and_say_what_that_costs() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --method pvmf -o a.loden");
    json(at, "compress small --method klt -o b.loden");
    let request =
        "generate exchange --structure a.loden --reflectance b.loden --clusters 12 --match assignment -o c.loden";
    let done = json(at, request);
    assert_eq!((done["rows"][0].as_u64(), done["match"].as_str()), (Some(12), Some("assignment")));
    assert!((0..2).all(|k| (0.0..0.2).contains(&done["clustering_error"][k].as_f64().unwrap())), "{done}");
    let output = crate::common::loden(at, &format!("{request} --force"));
    assert!(crate::common::text(&output.stderr).contains("were clustered into 12, with a mean error of"));
    json(at, "generate blend small.zip b.loden --clusters 8 --amount 0.4 -o d.loden");
    json(at, "compare small.zip c.loden d.loden");
}

#[test]
fn an_index_image_shows_its_pattern_with_another_block() {
    let dir = workshop();
    let at = dir.path();
    for (name, seed) in [("a", 1), ("b", 2)] {
        json(at, &format!("compress small.zip --method kmeans --clusters 9 --seed {seed} -o {name}.loden"));
        json(at, &format!("decompress {name}.loden --parts {name}"));
    }
    fs::copy(at.join("b/block.npy"), at.join("a/block.npy")).unwrap();
    json(at, "compress --from-parts a -o c.loden");
    json(at, "generate exchange --structure a.loden --reflectance b.loden --match index -o d.loden");
    json(at, "decompress d.loden --parts d");
    assert!(bytes(at, "a/block.npy") == bytes(at, "d/block.npy"));
    assert!(bytes(at, "a/index.png") == bytes(at, "d/index.png"));
    // what a paint program may do to an index image
    image::RgbImage::new(12, 12).save(at.join("a/index.png")).unwrap();
    let error = failure(at, "compress --from-parts a -o e.loden", 1);
    assert!(error.contains("index.png: pixels: found Rgb8, expected grey of 8 or 16 bits"), "{error}");
    image::GrayImage::from_pixel(12, 12, image::Luma([9])).save(at.join("a/index.png")).unwrap();
    let error = failure(at, "compress --from-parts a -o e.loden", 1);
    assert!(error.contains("index.png: pixels: texel 0 has row 9, expected less than 9"), "{error}");
    json(at, "compress small.zip --method kmeans --clusters 5 -o f.loden");
    json(at, "decompress f.loden --parts f");
    fs::copy(at.join("f/block.npy"), at.join("b/block.npy")).unwrap();
    let error = failure(at, "compress --from-parts b -o e.loden", 1);
    assert!(error.contains("block.npy: header: found"), "{error}");
}

#[test]
fn an_index_image_of_many_rows_is_not_read_from_8_bits() {
    let dir = workshop();
    let at = dir.path();
    json(at, "acquire gravel --size 20 --spp 1 --grid 64 -o g.zip");
    json(at, "compress g.zip --method kmeans --clusters 300 -o a.loden");
    json(at, "decompress a.loden --parts a");
    // as a paint program saves it
    let index = image::open(at.join("a/index.png")).unwrap();
    index.into_luma8().save(at.join("a/index.png")).unwrap();
    let error = failure(at, "compress --from-parts a -o b.loden", 1);
    assert!(error.contains("index.png: pixels: found 8 bits, which cannot number 300 rows"), "{error}");
}

#[test]
fn a_family_is_made_by_edits_and_depends_on_its_seed() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --method kmeans --clusters 9 -o a.loden");
    let done = json(at, "generate family a.loden -n 2 --object sphere -o one --threads 1");
    json(at, "generate family a.loden -n 2 --object sphere -o two --threads 2");
    json(at, "generate family a.loden -n 2 --object sphere -o three --seed 1");
    for file in ["a-01.loden", "a-02.loden"] {
        assert!(bytes(at, &format!("one/{file}")) == bytes(at, &format!("two/{file}")), "{file}");
        assert!(bytes(at, &format!("one/{file}")) != bytes(at, &format!("three/{file}")), "{file}");
    }
    let [one, two] = ["one", "two"].map(|folder| crate::common::pixels(&at.join(folder).join("sheet.png")));
    assert!(one == two);
    // a variant is what the edit with its numbers makes
    let edit = &done["variants"][1]["edit"];
    let turn = &edit["recolor"]["turn"];
    let line = format!(
        "edit a.loden --recolor hue={},saturation={},lightness={} --gloss {} --highlights {} --contrast {} -o b.loden",
        turn["hue"], turn["saturation"], turn["lightness"], edit["gloss"], edit["highlights"], edit["contrast"]
    );
    json(at, &line);
    assert!(bytes(at, "b.loden") == bytes(at, "one/a-02.loden"), "{line}");
    json(at, "generate family a.loden -n 1 --spread 0 --object sphere -o same");
    assert!(bytes(at, "same/a-01.loden") == bytes(at, "a.loden"));
    let error = failure(at, "generate family a.loden -n 2 -o one", 1);
    assert!(error.contains("one"), "{error}");
    let error = failure(at, "generate family a.loden -n 2 --spread 3 -o four", 2);
    assert!(error.contains("spread: found 3, expected 0 to 2"), "{error}");
    assert!(!at.join("four").exists());
}

#[test]
fn masks_choose_texels_and_bad_input_is_named() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --method kmeans --clusters 9 -o a.loden");
    image::GrayImage::from_fn(12, 12, |x, _| image::Luma([if x < 6 { 255 } else { 0 }]))
        .save(at.join("m.png"))
        .unwrap();
    let done = json(at, "edit a.loden --desaturate 1 --mask m.png -o b.loden");
    assert!(done["rows"][1].as_u64() > done["rows"][0].as_u64(), "{done}");
    json(at, "compress small --method kmeans --clusters 4 -o s.loden");
    json(at, "generate blend a.loden s.loden --mask m.png --amount 1 -o c.loden");
    // where the mask is black, nothing changes but the precision
    let [before, after] = ["a.loden", "c.loden"].map(|file| {
        json(at, &format!("decompress {file} --light 40,60 --view 0,0 -o p.exr"));
        crate::common::pixels(&at.join("p.exr"))
    });
    let off = |left: bool| {
        let at = |k: &usize| (k / 3 % 12 < 6) == left;
        (0..before.len()).filter(at).map(|k| (before[k] - after[k]).abs()).fold(0.0, f32::max)
    };
    assert!(off(false) < 1e-3 && off(true) > 1e-2, "{} {}", off(false), off(true));
    image::GrayImage::new(5, 12).save(at.join("n.png")).unwrap();
    let error = failure(at, "edit a.loden --gloss 2 --mask n.png -o x.loden", 1);
    assert!(error.contains("n.png: size: found 5 x 12, the material has 12 x 12"), "{error}");
    for (flags, message) in [
        ("--rows 3,9", "rows: found 9, expected less than 9"),
        ("--rows 3-1", "rows: found \"3-1\""),
        ("--gloss 0", "gloss: found 0, expected 0.05 to 20"),
        ("--recolor hue=x", "hue"),
        ("--recolor from=000000", "from and to"),
        ("--tint 12", "six hexadecimal digits"),
        ("--grow 12,0", "grow: found texel 12,0"),
        ("--colors ff00ff,1", "no row has such a mean colour"),
        ("--rows 1 --grow 1,1", "cannot be used with"),
    ] {
        let error = failure(at, &format!("edit a.loden --exposure 1 {flags} -o x.loden"), 2);
        assert!(error.contains(message), "{flags}: {error}");
    }
    let error = failure(at, "generate blend a.loden s.loden --amount 2 -o x.loden", 2);
    assert!(error.contains("amount: found 2"), "{error}");
    let error =
        failure(at, "generate exchange --structure a.loden --reflectance s.loden --match index --split -o x.loden", 2);
    assert!(error.contains("split: rows are split by transport, not by index"), "{error}");
    let error = failure(at, "generate exchange --structure ward --reflectance a.loden -o x.loden", 1);
    assert!(error.contains("ward: holds a BRDF, a BTF is needed here"), "{error}");
}
