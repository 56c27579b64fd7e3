//! Outputs are checked before the work: nothing is overwritten by accident.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::common::{LODEN, failure, json, loden, text, workshop};
use serde_json::Value;

/// Every file below a folder with its content.
fn content(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(content(&path));
        } else {
            found.push((path.display().to_string(), fs::read(&path).unwrap()));
        }
    }
    found.sort();
    found
}

#[test]
fn an_output_that_is_the_source_is_refused_even_by_force() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --components 3 --method pvmf -o x.loden");
    fs::write(at.join("q.csv"), "1,2,3,4\n").unwrap();
    #[cfg(unix)]
    std::os::unix::fs::symlink(at.join("small.zip"), at.join("link.zip")).unwrap();
    let before = content(at);
    let lines = [
        "convert small.zip small.zip",
        "convert small.zip link.zip",
        "convert link.zip small.zip",
        "convert small.toml small.toml",
        "convert small small",
        "decompress x.loden -o x.loden/../x.loden --to raw",
        "compress x.loden -o x.loden",
        "compress small.zip -o small.zip",
        "eval small.zip --queries q.csv -o q.csv",
        "fit ward --model phong --dump small.zip/../small.zip --spheres small.zip",
        "render --object sphere --material small.zip -o small.zip",
        "demo small -o .",
        "sweep small.zip -o .",
    ];
    for line in lines {
        let output = loden(at, &format!("{line} --force"));
        assert!(!output.status.success(), "{line}");
        assert!(content(at) == before, "{line} changed something: {}", text(&output.stderr));
    }
    let message = failure(at, "convert small.zip link.zip --force", 2);
    assert!(message.contains("output: link.zip is the source; name another output"), "{message}");
    let message = failure(at, "compress small.zip -o out.zip", 2);
    assert!(message.contains("output: out.zip does not end in .loden"), "{message}");
}

#[test]
fn existing_outputs_need_force() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --components 3 --method pvmf -o x.loden");
    fs::write(at.join("q.csv"), "1,2,3,4\n").unwrap();
    let lines = [
        "compress small.zip --components 3 --method pvmf -o a.loden",
        "convert small.zip a.zip",
        "convert small.zip folder",
        "convert small.zip raw.toml",
        "convert ward a.bsdf --no-check",
        "decompress x.loden -o b.zip",
        "decompress x.loden --light -30,60 --view 0,0 -o one.png",
        "decompress x.loden --parts parts",
        "acquire gravel --size 2 --spp 1 --grid 64 -o g.zip",
        "acquire gravel --raw --pixels 32 --spp 1 --grid 64 --exposures 1 -o photographs",
        "eval small.zip --queries q.csv -o values.csv",
        "brdf eval ward --queries q.csv -o model.csv",
        "brdf spheres ward --size 8 -o spheres.png",
        "brdf plot ward --size 8 -o plots",
        "fit ward --model phong --starts 1 --dump samples.csv",
        "fit ward --model phong --starts 1 --polar polar.svg",
        "fit ward --model phong --starts 1 --spheres fits.png",
        "factor ward --method svd --resolution 8 --terms 2 -o factored",
        "synthesize x.loden --size 20 -o large.loden",
        "synthesize x.loden --size 20 -o larger.loden --map map.exr",
        "render --object sphere --material x.loden --size 8 --spp 1 -o r.exr",
        "render --sheet small.zip x.loden --size 8 --spp 1 -o sheet.html",
        "sweep small.zip --methods analytic --draft -o swept",
        "demo small.zip --draft --components 2 -o page",
        "man -o manual",
    ];
    for line in lines {
        let first = loden(at, line);
        assert!(first.status.success(), "{line}: {}", text(&first.stderr));
        let before = content(at);
        let message = failure(at, line, 1);
        assert!(message.contains(" exists already; --force replaces it"), "{line}: {message}");
        assert!(content(at) == before, "{line} changed something");
        json(at, line);
    }
    // a folder that is someone else's is not replaced as a whole
    fs::create_dir(at.join("mine")).unwrap();
    fs::write(at.join("mine/letter.txt"), "dear").unwrap();
    let message = failure(at, "convert small.zip mine --force", 2);
    assert!(message.contains("mine is a folder with other content"), "{message}");
    assert_eq!(fs::read_to_string(at.join("mine/letter.txt")).unwrap(), "dear");
    // nothing of an older measurement stays among the new files
    let count = |folder: &str| content(&at.join(folder)).len();
    fs::write(at.join("folder/notes.txt"), "x").unwrap();
    json(at, "convert small.zip folder");
    assert_eq!(count("folder"), 49);
}

#[test]
fn outputs_are_checked_before_the_work() {
    let dir = workshop();
    let at = dir.path();
    let lines = [
        "render --object teapot --material small.zip --size 4096 --spp 4096 -o nowhere/x.png",
        "render --object teapot --material small.zip --size 4096 --spp 4096 -o x.png --checkpoint nowhere/c.bin",
        "fit small.zip --starts 100000 --spheres nowhere/x.png",
        "fit small.zip --starts 100000 --polar nowhere/x.svg",
        "fit small.zip --starts 100000 --dump nowhere/x.csv",
        "acquire gravel --spp 60000 -o nowhere/x.zip",
        "sweep small.zip -o small.zip/x",
        "demo --spp 60000 -o small.zip/x",
        "factor ward --method svd -o small.zip/x",
        "synthesize small.zip --size 16384 --method efros-leung -o nowhere/x.loden",
        "brdf plot ward -o small.zip/x",
        "convert small.zip nowhere/x.btf",
        "decompress nowhere.loden -o nowhere/x.zip",
    ];
    for line in lines {
        let message = failure(at, line, 1);
        let place = if line.contains("small.zip/x") { "small.zip/x" } else { "nowhere/" };
        assert!(message.starts_with(&format!("error: {place}")), "{line}: {message}");
        let reason = ["there is no folder nowhere\n", "small.zip is not a folder\n"];
        assert!(reason.iter().any(|reason| message.ends_with(reason)), "{line}: {message}");
        assert!(
            !message.contains("partial") && !message.contains("os error") && !message.contains("Os {"),
            "{message}"
        );
    }
}

#[test]
#[cfg(unix)]
fn a_full_disk_is_the_fault_of_the_output() {
    let dir = workshop();
    let at = dir.path();
    for line in [
        "convert small.toml x.zip --png",
        "convert small.toml folder --quality 100",
        "convert small.toml x.toml",
        "convert small.toml x.btf",
        "convert small.toml x.btf --to bdi",
        "convert ward x.bsdf",
        "convert ward x.binary",
        "library add shelf small.zip --methods none",
        "acquire gravel --raw --pixels 64 --spp 1 --grid 64 --exposures 1 -o photographs",
    ] {
        let script = format!("trap '' XFSZ; ulimit -f 1; exec {LODEN} {line}");
        let output = Command::new("bash").args(["-c", &script]).current_dir(at).output().unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{line}: {message}");
        let last = message.lines().last().unwrap();
        assert!(
            last.starts_with("error: ") && last.ends_with(": cannot be written: File too large"),
            "{line}: {message}"
        );
        assert!(!message.contains("partial") && !last.contains("error: small.zip"), "{line}: {message}");
    }
}

#[test]
fn standard_output_is_a_dash() {
    let dir = workshop();
    let at = dir.path();
    fs::write(at.join("q.csv"), "30,0,30,180\n").unwrap();
    let bytes = |line: &str| {
        let output = loden(at, line);
        assert!(output.status.success(), "{line}: {}", text(&output.stderr));
        output.stdout
    };
    let png = bytes("render --object sphere --material small.zip --size 8 --spp 1 -o - --quiet");
    assert!(png.starts_with(b"\x89PNG") && image::load_from_memory(&png).is_ok());
    assert!(
        text(&bytes("eval ward --queries q.csv -o -")).starts_with("theta_i,phi_i,theta_o,phi_o,r,g,b\n30,0,30,180,")
    );
    assert!(text(&bytes("fit ward --model phong --starts 1 --polar -")).starts_with("<svg"));
    json(at, "compress small.zip --components 3 --method pvmf -o x.loden");
    assert!(bytes("compress small.zip --components 3 --method pvmf -o -") == fs::read(at.join("x.loden")).unwrap());
    assert!(bytes("convert ward - --to astm").starts_with(b"ASTM") || !bytes("convert ward - --to astm").is_empty());
    assert!(bytes("decompress x.loden -o -").starts_with(b"PK"));
    // what is not a single file is not
    assert!(failure(at, "convert small.zip - --to raw", 2).contains("output: raw is not a single file"));
    assert!(failure(at, "sweep small.zip -o -", 2).contains("a folder cannot be written to standard output"));
    assert!(failure(at, "fit ward --dump - --polar -", 2).contains("named twice"));
}

#[test]
fn errors_are_json_too() {
    let dir = workshop();
    let at = dir.path();
    let error = |line: &str, code: i32| {
        let output = loden(at, &format!("{line} --json"));
        assert_eq!(output.status.code(), Some(code), "{line}: {}", text(&output.stderr));
        assert!(text(&output.stderr).contains("error: "), "{line}");
        let value: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{line}: {e}"));
        assert_eq!(value.as_object().unwrap().len(), 1, "{value}");
        value["error"].clone()
    };
    let missing = error("info nowhere.zip", 1);
    assert_eq!((&missing["kind"], &missing["file"]), (&Value::from("io"), &Value::from("nowhere.zip")));
    assert_eq!(missing["message"], "nowhere.zip: No such file or directory");
    let wrong = error("compress small.zip --components 0 --method pvmf -o x.loden", 2);
    assert_eq!((&wrong["kind"], &wrong["file"]), (&Value::from("usage"), &Value::Null));
    assert!(wrong["message"].as_str().unwrap().starts_with("components: found \"0\""));
    let usage = error("render --object sphere --material small.zip -o x.png --threads 0", 2);
    assert_eq!(usage["message"], "invalid value '0' for '--threads <N>': at least 1 is expected");
    let exists = error("convert small.zip small.toml", 1);
    assert_eq!((&exists["kind"], &exists["file"]), (&Value::from("exists"), &Value::from("small.toml")));
}

#[test]
fn wrong_values_are_explained_in_sentences() {
    let dir = workshop();
    let at = dir.path();
    for (line, expected) in [
        ("info small.zip --threads 0", "at least 1 is expected"),
        ("info small.zip --threads many", "a whole number is expected"),
        ("render --object sphere --material small.zip --spp abc -o x.png", "a whole number is expected"),
        ("render --object sphere --material small.zip --spp -4 -o x.png", "at least 0 is expected"),
        ("render --object sphere --material small.zip --spp 99999999999 -o x.png", "at least 0 is expected"),
        ("render --object sphere --material small.zip --uv-scale wide -o x.png", "a number is expected"),
        ("render --object sphere --material small.zip --light a,60 -o x.png", "found \"a\", a number is expected"),
        ("render --object sphere --material small.zip --light -95,60 -o x.png", "the polar angle is -95"),
        ("fit ward --anisotropic maybe", "possible values: true, false"),
    ] {
        let message = failure(at, line, 2);
        assert!(message.contains(expected) && !message.contains("digit") && !message.contains("float"), "{message}");
    }
    // negative angles are angles
    json(at, "render --object sphere --material small.zip --size 8 --spp 1 --light -30,60 -o a.exr");
    json(at, "render --object sphere --material small.zip --size 8 --spp 1 --light 30,240 -o b.exr");
    let pixels = |name: &str| crate::common::pixels(&at.join(name));
    assert_eq!(pixels("a.exr"), pixels("b.exr"));
    fs::write(at.join("bad.toml"), "loden_raw = 'one'\n").unwrap();
    let message = failure(at, "info bad.toml", 1);
    assert!(message.contains("found the text \"one\", expected a whole number"), "{message}");
}

#[test]
#[cfg(unix)]
fn an_interrupted_command_ends_by_its_signal() {
    use std::os::unix::process::ExitStatusExt;
    let dir = workshop();
    let at = dir.path();
    for (signal, number) in [("INT", 2), ("TERM", 15)] {
        let line =
            format!("render --object sphere --material small.zip --size 64 --spp 4000000 --checkpoint {signal}.bin");
        let mut words: Vec<&str> = line.split(' ').collect();
        words.extend(["-o", "x.exr", "--quiet", "--json"]);
        let stdout = fs::File::create(at.join("out.json")).unwrap();
        let mut child = Command::new(LODEN).args(words).current_dir(at).stdout(stdout).spawn().unwrap();
        while !at.join(format!("{signal}.bin")).exists() {
            assert!(child.try_wait().unwrap().is_none(), "it ended without a checkpoint");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let killed = Command::new("kill").args([format!("-{signal}"), child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        assert_eq!(child.wait().unwrap().signal(), Some(number));
        let value: Value = serde_json::from_slice(&fs::read(at.join("out.json")).unwrap()).unwrap();
        assert_eq!(value["error"]["kind"], "cancelled");
        let left =
            fs::read_dir(at).unwrap().filter(|e| e.as_ref().unwrap().file_name().to_string_lossy().contains("partial"));
        assert!(left.count() == 0 && !at.join("x.exr").exists());
    }
}

#[test]
fn a_sweep_with_failures_fails() {
    let dir = workshop();
    let at = dir.path();
    // a folder stands where a compressed file should go
    fs::create_dir_all(at.join("swept/kmeans-clusters-12.loden")).unwrap();
    let settings = loden(at, "sweep small.zip --methods analytic,kmeans --draft -o first --json");
    let rows: Value = serde_json::from_slice(&settings.stdout).unwrap();
    let file = |row: &Value| Path::new(row["file"].as_str().unwrap()).file_name().unwrap().to_owned();
    let of_kmeans = rows.as_array().unwrap().iter().find(|row| row["method"] == "kmeans").unwrap();
    fs::create_dir_all(at.join("second").join(file(of_kmeans))).unwrap();
    let output = loden(at, "sweep small.zip --methods analytic,kmeans --draft -o second --json --force");
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("error: 1 setting failed: kmeans "), "{}", text(&output.stderr));
    let kept: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(kept.as_array().unwrap().len() + 1, rows.as_array().unwrap().len());
}

#[test]
fn several_sources_are_described_and_every_picture_is_read() {
    let dir = workshop();
    let at = dir.path();
    let one = json(at, "info small.zip");
    assert_eq!((&one["images_read"], &one["file"]), (&Value::from(49), &Value::from("small.zip")));
    let all = json(at, "info small.zip small.toml ggx:alpha-x=0.2 --check");
    assert_eq!(all.as_array().unwrap().len(), 3);
    assert_eq!((&all[1]["images_read"], &all[2]["kind"]), (&Value::from(49), &Value::from("ggx")));
    // a picture of a view far from the normal is damaged
    let mut zip = fs::read(at.join("small.zip")).unwrap();
    let end = zip.len() / 2;
    zip[end..end + 400].fill(0xaa);
    fs::write(at.join("hurt.zip"), zip).unwrap();
    assert!(loden(at, "info hurt.zip").status.success());
    let output = loden(at, "info hurt.zip --check --json");
    assert_eq!(output.status.code(), Some(1));
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(!value["unreadable"].as_array().unwrap().is_empty(), "{value}");
    assert!(text(&output.stderr).contains("cannot be read"), "{}", text(&output.stderr));
    let output = loden(at, "info small.zip nowhere.zip --json");
    assert_eq!(output.status.code(), Some(1));
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(value[0]["width"] == 12 && value[1]["error"].as_str().unwrap().contains("No such file"), "{value}");
}

#[test]
fn a_folder_without_materials_is_no_library() {
    let dir = workshop();
    let message = failure(dir.path(), "library list .", 1);
    assert!(message.contains("is not a library"), "{message}");
    assert!(failure(dir.path(), "library list nowhere", 1).contains("nowhere: No such file"));
    json(dir.path(), "library add shelf small.zip --methods none");
    json(dir.path(), "library remove shelf small");
    assert_eq!(json(dir.path(), "library list shelf"), Value::Array(Vec::new()));
}

#[test]
fn names_of_models_and_library_entries_are_materials() {
    let dir = workshop();
    let at = dir.path();
    json(at, "library add lib small.zip --name brushed --methods none");
    json(at, "library add lib small.toml --name raw --methods none --link");
    let pixels = |name: &str| crate::common::pixels(&at.join(name));
    let look = "--object sphere --size 8 --spp 1";
    for (material, same) in [("lib/brushed", "small.zip"), ("lib/raw", "small.toml")] {
        json(at, &format!("render {look} --material {material} -o a.exr"));
        json(at, &format!("render {look} --material {same} -o b.exr"));
        assert_eq!(pixels("a.exr"), pixels("b.exr"));
    }
    assert_eq!(json(at, "info lib/brushed")["width"], 12);
    json(at, "compress lib/brushed --method pvmf --components 3 -o a.loden");
    json(at, "compress small.zip --method pvmf --components 3 -o b.loden");
    assert_eq!(fs::read(at.join("a.loden")).unwrap(), fs::read(at.join("b.loden")).unwrap());
    json(at, "compare lib/brushed a.loden");
    json(at, "convert lib/brushed x.toml");
    fs::write(at.join("q.csv"), "10,0,20,0\n").unwrap();
    json(at, "eval ggx:alpha-x=0.2 --queries q.csv -o values.csv");
    json(at, "brdf eval ggx:alpha-x=0.2:kd=0.1 --queries q.csv -o other.csv");
    json(at, &format!("render {look} --material ggx:alpha-x=0.2 -o c.exr"));
    json(at, "render --sheet lib/brushed a.loden --size 8 --spp 1 -o sheet.png");
    // in a scene, too
    let scene = "[camera]\nposition = [0, 0, 4]\ntarget = [0, 0, 0]\n[environment]\nradiance = 1\n\
                 [material.m]\nfile = \"NAME\"\n[[shape]]\nkind = \"sphere\"\nmaterial = \"m\"\n";
    let render = |name: &str, output: &str| {
        fs::write(at.join("scene.toml"), scene.replace("NAME", name)).unwrap();
        json(at, &format!("render --scene scene.toml --size 8 --spp 1 -o {output}"));
        pixels(output)
    };
    assert_eq!(render("lib/brushed", "d.exr"), render("small.zip", "e.exr"));
    assert_ne!(render("ggx:alpha-x=0.2", "f.exr"), render("small.zip", "g.exr"));
    let scene = "Projection \"perspective\"\nTranslate 0 0 4\nWorldBegin\n\
                 Surface \"loden\" \"string material\" \"NAME\"\n\nSphere 1 -1 1 360\nWorldEnd\n";
    let rib = |name: &str| {
        fs::write(at.join("scene.rib"), scene.replace("NAME", name)).unwrap();
        json(at, "render --scene scene.rib --size 8 --spp 1 -o rib.exr");
        pixels("rib.exr")
    };
    assert_eq!(rib("lib/brushed"), rib("small.zip"));
    rib("ggx:alpha-x=0.2");
    fs::write(at.join("scene.rib"), scene.replace("NAME", "nowhere.loden")).unwrap();
    let message = failure(at, "render --scene scene.rib --size 8 -o rib.png", 1);
    assert!(message.contains("the Surface of line 4: ") && message.contains("nowhere.loden"), "{message}");
}

#[test]
fn pictures_for_people() {
    let dir = workshop();
    let at = dir.path();
    let line = "render --object sphere --material small.zip --size 48 --spp 16";
    let mean = |name: &str| {
        let pixels = crate::common::pixels(&at.join(name));
        pixels.iter().sum::<f32>() / pixels.len() as f32
    };
    json(at, &format!("{line} -o a.exr"));
    json(at, &format!("{line} --exposure 2 -o b.exr"));
    assert!((mean("b.exr") / mean("a.exr") - 2.0).abs() < 1e-4);
    for tone in ["linear", "filmic", "agx"] {
        json(at, &format!("{line} --exposure 4 --tone-map {tone} -o {tone}.png"));
    }
    assert!(mean("agx.png") < mean("filmic.png") && mean("filmic.png") < mean("linear.png"));
    assert!(failure(at, &format!("{line} --tone-map agx -o c.exr"), 2).contains("an .exr holds linear light"));
    assert!(failure(at, &format!("{line} --exposure -1 -o c.exr"), 2).contains("exposure: found -1"));
    // the mean stays, noise goes
    json(at, &format!("{line} --denoise true -o d.exr"));
    assert!((mean("d.exr") / mean("a.exr") - 1.0).abs() < 0.01, "{} {}", mean("d.exr"), mean("a.exr"));
    let corner = |name: &str| {
        let pixels = crate::common::pixels(&at.join(name));
        let values: Vec<f32> = (0..12).flat_map(|x| [44, 46].map(|y| pixels[3 * (48 * y + x) + 1])).collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        values.iter().map(|v| (v / mean - 1.0).powi(2)).sum::<f32>().sqrt()
    };
    assert!(corner("d.exr") < 0.5 * corner("a.exr"), "{} {}", corner("d.exr"), corner("a.exr"));
}
