//! What commands make is taken by the other commands: factored BRDFs, averaged BTFs.

use std::fs;
use std::path::Path;

use crate::common::{failure, json, loden, text, workshop};

/// The values of a material at a few directions.
fn values(at: &Path, material: &str) -> Vec<f64> {
    fs::write(at.join("queries.csv"), "20,30,0,0\n40,0,40,180\n10,200,60,90\n").unwrap();
    json(at, &format!("eval {material} --queries queries.csv -o values.csv"));
    let table = fs::read_to_string(at.join("values.csv")).unwrap();
    table.lines().skip(1).flat_map(|line| line.split(',').skip(4).map(|word| word.parse().unwrap())).collect()
}

#[test]
fn a_factored_brdf_is_a_material_for_every_command() {
    let dir = workshop();
    let at = dir.path();
    let ward = "ward:alpha-x=0.4:alpha-y=0.5:kd=0.3,0.2,0.1:ks=0.1";
    let original = values(at, ward);
    for flags in ["hf", "svd --terms 4", "cmf --factors 3"] {
        let made = json(at, &format!("factor {ward} --method {flags} -o factored"));
        let file = made["material"].as_str().unwrap();
        let info = json(at, &format!("info {file}"));
        assert_eq!((&info["kind"], &info["method"]), (&"factored".into(), &flags.split(' ').next().unwrap().into()));
        assert_eq!((&info["factored_from"], &info["rmse"]), (&ward.into(), &made["rmse"]));
        let difference: f64 = values(at, file).iter().zip(&original).map(|(a, b)| (a - b).abs()).sum();
        assert!(difference < 0.3 * original.iter().sum::<f64>(), "{flags}: {difference} of {original:?}");
        json(at, &format!("render --object sphere --material {file} --size 8 --spp 1 -o ball.png"));
        let converted = json(at, &format!("convert {file} factored.bsdf"));
        assert!(converted["relative_error"].as_f64().unwrap() < 0.05, "{flags}: {converted}");
        json(at, &format!("library add shelf {file} --name {}", flags.split(' ').next().unwrap()));
    }
    let shelf = json(at, "library verify shelf");
    assert_eq!((shelf["materials"].as_u64(), shelf["damaged"].as_u64()), (Some(3), Some(0)));
}

#[test]
fn exported_materials_are_complete_or_refused() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --method pvmf --components 3 -o a.loden");
    let made = json(at, "export a.loden --to mitsuba -o plug-in");
    let files = fs::read_dir(at.join("plug-in")).unwrap().count();
    assert_eq!((made["renderer"].as_str(), made["files"].as_u64()), (Some("mitsuba"), Some(files as u64)));
    let text = fs::read_to_string(at.join("plug-in/material.json")).unwrap();
    let description: serde_json::Value = serde_json::from_str(&text).unwrap();
    let recipe = &description["recipe"];
    for (kind, prefix) in [("planes", "plane"), ("tables", "table")] {
        for part in recipe[kind].as_array().unwrap() {
            let file = format!("plug-in/{prefix}-{}.npy", part["name"].as_str().unwrap());
            assert!(fs::read(at.join(&file)).unwrap().starts_with(b"\x93NUMPY"), "{file}");
        }
    }
    assert!(fs::metadata(at.join("plug-in/ball.png")).unwrap().len() > 1000);
    for target in ["wgsl", "glsl", "three"] {
        let made = json(at, &format!("export a.loden --to {target} -o shader-{target}"));
        assert_eq!(made["renderer"].as_str(), Some(target));
        let page = fs::read_to_string(at.join(format!("shader-{target}/index.html"))).unwrap();
        assert!(!page.contains("http:") && !page.contains("https:") && !page.contains("src="), "a page asks for files");
    }
    // an existing export is replaced only if asked
    assert!(failure(at, "export a.loden --to mitsuba -o plug-in", 1).contains("--force replaces it"));
    json(at, "export a.loden --to mitsuba -o plug-in");
    json(at, "compress small.zip --method analytic -o b.loden");
    let error = failure(at, "export b.loden --to mitsuba -o none", 1);
    assert!(error.contains("b.loden") && error.contains("analytic BRDF"), "{error}");
    assert!(!at.join("none").exists());
    assert!(failure(at, "export small.zip --to mitsuba -o none", 1).contains("small.zip"));
    assert!(failure(at, "export a.loden --to povray -o none", 2).contains("possible values: mitsuba"));
}

#[test]
fn a_btf_is_averaged_by_a_format_of_brdfs() {
    let dir = workshop();
    let at = dir.path();
    for file in ["mean.bsdf", "mean.binary", "mean.astm"] {
        let made = json(at, &format!("convert small.zip {file}"));
        assert_eq!(made["samples"], 49);
        assert!(made["relative_error"].as_f64().unwrap() < 0.3, "{file}: {made}");
    }
    // the fit of the BTF, which averages it too, fits the average as well
    let [btf, mean] = ["small.zip", "mean.bsdf"].map(|source| {
        let fit = json(at, &format!("fit {source} --model lambert --starts 1 --at even"));
        fit["fits"][0]["params"]["kd"][1].as_f64().unwrap()
    });
    assert!((btf / mean - 1.0).abs() < 0.05, "{btf} {mean}");
}

#[test]
fn yarns_and_meshes_are_measured_with_their_holes() {
    let dir = workshop();
    let at = dir.path();
    // a square with a quarter missing, y up
    let quads = ["0 0 0,1 0 0,1 0 -.5,0 0 -.5", "0 0 -.5,.5 0 -.5,.5 0 -1,0 0 -1"];
    let vertices: String = quads.iter().flat_map(|quad| quad.split(',')).map(|v| format!("v {v}\n")).collect();
    fs::write(at.join("ell.obj"), vertices + "f 1 2 3 4\nf 5 6 7 8\n").unwrap();
    let measured =
        json(at, "acquire mesh --object ell.obj --specular 0 --size 4 --spp 4 --coverage holes.toml -o ell.toml");
    assert_eq!((&measured["sample"], &measured["images"]), (&"mesh".into(), &6561.into()));
    let info = json(at, "info holes.toml");
    assert_eq!((&info["view_directions"], &info["highest"]), (&"bonn81".into(), &1.0.into()), "{info}");
    let seen = values(at, "holes.toml");
    assert!((seen[0] - 0.75).abs() < 0.26 && seen.len() == 9, "{seen:?}");
    let yarn = json(at, "acquire yarn --yarns 4 --points 8 --weave basket --size 4 --spp 1 --depth 2 -o cloth.toml");
    assert_eq!(yarn["sample"], "yarn");
    assert!(values(at, "cloth.toml").iter().all(|value| (0.0..=2.0).contains(value)));
    json(at, "acquire mesh --object ell.obj --raw --pixels 32 --spp 1 --exposures 1 -o raw");
}

#[test]
fn forms_are_added_to_a_library_with_parameters() {
    let dir = workshop();
    let at = dir.path();
    json(at, "library add shelf small.zip --methods pvmf --components 2");
    let shown = json(at, "library compress shelf small --methods pvmf,median-cut --components 5 --clusters 16");
    let forms = shown["material"]["compressed"].as_array().unwrap();
    let components = |k: usize| forms[k]["params"]["components"].as_u64();
    assert_eq!((forms.len(), components(0), components(1)), (3, Some(2), Some(5)));
    let listed = text(&loden(at, "library show shelf small").stdout);
    assert!(listed.contains("pvmf-components-5.loden"), "{listed}");
}
