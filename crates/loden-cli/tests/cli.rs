//! The command line is a contract: names, JSON keys, exit codes and messages.

use std::fs;
use std::process::Command;

use crate::common::{LODEN, failure, json, loden, pixels, text, workshop};
use loden::btf::Texels;
use loden::color::Encoding;
use serde_json::Value;

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

#[test]
fn parts_come_out_as_files_and_make_the_same_file_again() {
    let dir = workshop();
    let at = dir.path();
    for method in ["kmeans --clusters 5", "pvmf --lossless zstd"] {
        json(at, &format!("compress small.zip --method {method} -o x.loden"));
        let parts = json(at, "decompress x.loden --parts parts");
        assert_eq!((parts["images"].as_u64(), parts["parts"].as_str()), (Some(0), Some("parts")));
        assert_eq!(parts["files"].as_u64(), Some(fs::read_dir(at.join("parts")).unwrap().count() as u64));
        let stored = json(at, "compress --from-parts parts -o y.loden");
        assert_eq!(stored["bytes"].as_u64(), Some(fs::metadata(at.join("y.loden")).unwrap().len()));
        assert!(fs::read(at.join("x.loden")).unwrap() == fs::read(at.join("y.loden")).unwrap(), "{method}");
        let error = failure(at, "decompress x.loden --parts parts", 1);
        assert!(error.contains("parts exists already; --force replaces it"), "{error}");
        fs::remove_dir_all(at.join("parts")).unwrap();
    }
    let error = failure(at, "compress --from-parts parts -o z.loden", 1);
    assert!(error.contains("recipe.json"), "{error}");
}

#[test]
fn the_json_keys_of_every_command() {
    let dir = workshop();
    let at = dir.path();
    let compress = json(at, "compress small.zip --method pvmf --components 3 -o a.loden");
    json(at, "compress small.zip --method pvmf --components 20 --precision f32 -o b.loden");
    let compare = json(at, "compare small.zip a.loden b.loden");
    let info = json(at, "info small");
    let packed = json(at, "info a.loden");
    let export = json(at, "export a.loden --to mitsuba -o plug-in");
    let decompress = json(at, "decompress a.loden -o out.zip --png");
    let convert = json(at, "convert small out.toml");
    let render = json(at, "render --object sphere --material a.loden --size 8x6 --spp 1 -o s.png");
    let acquire = json(at, "acquire gravel --size 2 --spp 1 --grid 64 -o g.zip");
    let demo = json(at, "demo small.zip --out page --components 2,4,1000 --draft");
    let sweep = json(at, "sweep small.zip --methods pvmf,kmeans -o swept --draft");
    let fit = json(at, "fit ward --model phong --starts 1");
    let factor = json(at, "factor ward --method svd --resolution 8 --terms 2 -o factored");
    let synthesize = json(at, "synthesize a.loden --size 20x9 --map map.png -o large.loden");
    image::RgbImage::new(12, 12).save(at.join("sized.png")).unwrap();
    let apply = json(at, "synthesize sized.png --apply map.png -o applied.png");
    json(at, "compress small.zip --method kmeans --clusters 4 -o k.loden");
    let exchange = json(at, "generate exchange --structure k.loden --reflectance k.loden -o x.loden");
    let blend = json(at, "generate blend k.loden k.loden -o x.loden");
    let family = json(at, "generate family k.loden -n 1 --object sphere -o family");
    let edit = json(at, "edit k.loden --exposure 1 -o x.loden");
    let edited = json(at, "info x.loden");
    let plot = json(at, "brdf plot ward -o plots --size 8");
    let spheres = json(at, "brdf spheres ward lambert -o spheres.png --size 16");
    let models = json(at, "brdf models");
    let library = json(at, "library add shelf small.zip --methods pvmf,pca");
    let listed = json(at, "library list shelf");
    let verified = json(at, "library verify shelf");
    let removed = json(at, "library remove shelf small");
    let photographs = json(at, "acquire gravel --raw --pixels 32 --spp 1 --grid 64 --exposures 1 -o raw");
    for light in 0..2 {
        image::RgbImage::from_pixel(12, 12, image::Rgb([90; 3])).save(at.join(format!("p{light}.png"))).unwrap();
    }
    let manifest = "loden_photographs = 1\nfiles = \"p{light}.png\"\nlights = [[0, 0], [30, 0]]\n\
                    corners = [[[0, 0], [12, 0], [12, 12], [0, 12]]]\n";
    fs::write(at.join("set.toml"), manifest).unwrap();
    let rectified = json(at, "rectify set.toml --size 12 -o rectified.toml");
    let all = [
        ("library add", &library),
        ("library list", &listed[0]),
        ("library verify", &verified),
        ("library remove", &removed),
        ("acquire --raw", &photographs),
        ("rectify", &rectified),
        ("rectify photograph", &rectified["photographs"][0]),
        ("fit", &fit),
        ("fit row", &fit["fits"][0]),
        ("factor", &factor),
        ("synthesize", &synthesize),
        ("synthesize --apply", &apply),
        ("generate exchange", &exchange),
        ("generate blend", &blend),
        ("generate family", &family),
        ("generate family variant", &family["variants"][0]),
        ("edit", &edit),
        ("edit changes", &edit["edit"]),
        ("info of an edited .loden", &edited),
        ("brdf plot", &plot),
        ("brdf spheres", &spheres),
        ("brdf models", &models[0]),
        ("compress", &compress),
        ("compare", &compare[0]),
        ("info", &info),
        ("info .loden", &packed),
        ("export", &export),
        ("decompress", &decompress),
        ("convert", &convert),
        ("render", &render),
        ("acquire", &acquire),
        ("demo", &demo),
        ("sweep", &sweep[0]),
    ];
    let table: Vec<String> = all.iter().map(|(name, value)| format!("{name}: {}", keys(value).join(", "))).collect();
    insta::assert_snapshot!(table.join("\n"));

    // parameters are objects with typed values everywhere
    let components = [&compress["params"], &compare[0]["params"], &packed["params"], &sweep[0]["params"]];
    assert_eq!(components.map(|params| params["components"].as_u64()), [Some(3), Some(3), Some(3), Some(2)]);
    assert_eq!(factor["params"]["terms"], 2);
    let declared = models.as_array().unwrap().iter().flat_map(|model| model["parameters"].as_array().unwrap());
    assert!(declared.filter(|p| p["range"].is_array()).all(|p| !p["default"].is_null() && !p["range"][0].is_null()));
    assert!(models[0]["parameters"][0]["default"].is_array(), "a colour: {}", models[0]);
    assert!(fit["fits"][0]["params"]["exponent"].is_f64() && fit["fits"][0]["params"]["kd"].is_array());
    let forms = &library["material"]["compressed"];
    assert!(forms[0]["params"]["components"].is_u64() && *forms == listed[0]["material"]["compressed"]);
    assert_eq!(compare.as_array().unwrap().len(), 2);
    let error = |i: usize| compare[i]["mean_abs_error"].as_f64().unwrap();
    let stored = [&compress["error"]["mean_abs_error"], &packed["mean_abs_error"]];
    assert!(stored.iter().all(|error| **error == compare[0]["mean_abs_error"]), "{stored:?}");
    assert!(error(0) > 0.005 && error(1) < 0.005, "{} {}", error(0), error(1));
    for row in compare.as_array().unwrap() {
        assert_eq!(row["bytes"].as_u64().unwrap(), fs::metadata(at.join(row["file"].as_str().unwrap())).unwrap().len());
        let raw8 = 7.0 * 7.0 * 432.0 / row["bytes"].as_f64().unwrap();
        assert!((row["ratio_raw8"].as_f64().unwrap() / raw8 - 1.0).abs() < 1e-9);
    }
    let of_pvmf = demo["rows"].as_array().unwrap().iter().filter(|row| row["method"] == "pvmf");
    assert_eq!(of_pvmf.count(), 2, "1000 components are more than there are");
    assert_eq!(demo["rows"][0]["method"], loden::codec::DEFAULT);
    let page = fs::read_to_string(at.join("page/index.html")).unwrap();
    assert!(page.contains("data:image/png;base64,") && !page.contains("<img src=\"http"));
    // published settings with more than 21 components are lowered to as many
    let methods: Vec<&str> = sweep.as_array().unwrap().iter().map(|row| row["method"].as_str().unwrap()).collect();
    assert_eq!(methods.iter().filter(|method| **method == "pvmf").count(), 7);
    assert!(methods.contains(&"kmeans") && sweep[0]["peak_rss_bytes"].as_u64().unwrap() > 0);
    let page = fs::read_to_string(at.join("swept/index.html")).unwrap();
    assert!(page.contains("<svg") && page.contains("data:image/jpeg;base64,") && !page.contains("src=\"http"));
    assert_eq!(info["kind"], "ubo2003");
    assert_eq!((&packed["kind"], &packed["method"]), (&Value::from("loden"), &Value::from("pvmf")));
}

#[test]
fn text_output_says_the_same() {
    let dir = workshop();
    let line = text(&loden(dir.path(), "info small.toml").stdout);
    assert!(
        line.contains("kind  raw") && line.contains("width  12") && line.contains("raw8_bytes  21.168 kB"),
        "{line}"
    );
}

#[test]
fn zip_folder_and_raw_array_compress_to_the_same_factors() {
    let dir = workshop();
    let decoded = ["small.zip", "small", "small.toml"].map(|source| {
        json(dir.path(), &format!("compress {source} --method pvmf --components 3 --precision f32 -o x.loden"));
        json(dir.path(), "decompress x.loden -o x.toml");
        let bytes = fs::read(dir.path().join("x.f32")).unwrap();
        fs::remove_file(dir.path().join("x.loden")).unwrap();
        bytes
    });
    assert!(decoded[0] == decoded[1] && decoded[1] == decoded[2]);
}

#[test]
fn threads_do_not_change_a_byte() {
    let dir = workshop();
    for threads in [1, 2] {
        json(
            dir.path(),
            &format!("compress small.zip --method pvmf --components 3 -o {threads}.loden --threads {threads}"),
        );
        json(dir.path(), &format!("acquire gravel --size 2 --spp 2 --grid 64 -o {threads}.toml --threads {threads}"));
        json(
            dir.path(),
            &format!(
                "render --object teapot --material {threads}.loden --size 12 --spp 4 -o {threads}.exr --threads {threads}"
            ),
        );
    }
    for kind in ["loden", "f32"] {
        let [one, two] = [1, 2].map(|n| fs::read(dir.path().join(format!("{n}.{kind}"))).unwrap());
        assert!(one == two, "{kind}");
    }
    // the files hold the commands
    assert_eq!(pixels(&dir.path().join("1.exr")), pixels(&dir.path().join("2.exr")));
}

#[test]
fn a_killed_picture_is_taken_up_again() {
    let dir = workshop();
    let at = dir.path();
    let line = "render --object sphere --material small.zip --size 64 --spp 768 --quiet";
    let started =
        || Command::new(LODEN).args(format!("{line} --checkpoint c.bin -o x.exr").split(' ')).current_dir(at).spawn();
    let mut child = started().unwrap();
    while !at.join("c.bin").exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended without a checkpoint");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!at.join("x.exr").exists(), "it was killed in the middle");
    let rest = json(at, &format!("{line} --checkpoint c.bin -o x.exr"));
    let whole = json(at, &format!("{line} -o y.exr"));
    assert_eq!((&rest["complete"], &rest["samples_per_pixel"]), (&Value::from(true), &whole["samples_per_pixel"]));
    assert_eq!(pixels(&at.join("x.exr")), pixels(&at.join("y.exr")));
    let other = line.replace("sphere", "teapot");
    let error = failure(at, &format!("{other} --checkpoint c.bin -o z.exr"), 1);
    assert!(error.contains("c.bin: scene: the file belongs to another scene"), "{error}");
    let short =
        json(at, "render --object sphere --material small.zip --size 64 --spp 1000000 --time-limit 0.2 -o z.exr");
    assert_eq!(short["complete"], Value::from(false));
}

#[test]
fn a_sheet_shows_what_compression_cost() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --method pvmf --components 1 -o coarse.loden");
    json(at, "compress small.zip --method pvmf --components 6 --precision f32 -o fine.loden");
    let line = "render --sheet small.zip coarse.loden fine.loden --size 40x30 --spp 64 --uv-scale 2";
    let rows = json(at, &format!("{line} -o sheet.png"));
    let error = |i: usize| rows[i]["mean_abs_error"].as_f64().unwrap();
    assert!(error(0) > 2.0 * error(1) && error(1) > 0.0, "{rows}");
    let sheet = image::open(at.join("sheet.png")).unwrap();
    assert_eq!((sheet.width(), sheet.height()), (3 * 40 + 12, 2 * 30 + 6 + 11));
    assert_eq!(json(at, &format!("{line} -o sheet.html")), rows);
    let page = fs::read_to_string(at.join("sheet.html")).unwrap();
    assert!(page.contains("coarse.loden") && page.contains("PSNR") && page.matches("data:image/png").count() == 5);
    let error = failure(at, "render --sheet small.zip coarse.loden --scene x.toml -o sheet.png", 2);
    assert!(error.contains("cannot be used with"), "{error}");
}

#[test]
fn one_image_for_any_directions() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --method pvmf --components 21 --precision f32 -o x.loden");
    json(at, "decompress x.loden --light 40,60 --view 0,0 -o measured.png");
    let picture = image::open(at.join("measured.png")).unwrap().into_rgb8();
    let original = loden::import::open(at.join("small.zip"), &Default::default()).unwrap();
    let Texels::U8(expected) = original.image(0, 2).unwrap() else { panic!() };
    for (a, b) in picture.as_raw().iter().zip(expected.iter()) {
        assert!(a.abs_diff(*b) <= 1, "{a} {b}");
    }
    json(at, "decompress x.loden --light 20,33.5 --view 85,300 -o between.exr");
    assert!(at.join("between.exr").exists());
}

#[test]
fn usage_errors_have_code_2_and_name_the_flag() {
    let dir = workshop();
    let cases = [
        ("", "Usage"),
        ("compress small.zip --method pvmf -o x.loden --components 0", "components: found \"0\""),
        ("compress small.zip -o x.loden --method jpeg", "invalid value 'jpeg' for '--method <METHOD>'"),
        (
            "compress small.zip --method pvmf -o x.loden --precision f8",
            "precision: found \"f8\", expected one of f32, f16, u8",
        ),
        ("compress small.zip -o x.loden --bytes 20q", "a number of bytes is expected"),
        ("compress small.zip -o x.loden --bytes 20k --quality 50", "cannot be used with"),
        ("compress small.zip -o x.loden --bytes 100", "bytes: found 100, but the smallest file has"),
        ("compress small.zip -o x.loden --max-error 1e-9 --method kmeans", "max-error: the smallest error"),
        ("compress small.zip -o x.loden --method analytic --quality 9", "method: analytic has nothing left to search"),
        ("sweep small.zip --methods jpeg -o swept", "invalid value 'jpeg'"),
        ("compress small.zip", "--output"),
        ("decompress x.loden --light 30 --view 0,0 -o x.png", "two angles"),
        ("decompress x.loden --light 95,0 --view 0,0 -o x.png", "0..90"),
        ("decompress x.loden --light 30,0 -o x.png", "--view"),
        ("acquire velvet -o x.zip", "invalid value 'velvet' for '<SAMPLE>'"),
        ("acquire twill --size 0 -o x.zip", "size: found \"0\""),
        ("acquire maps -o x.zip", "height: the sample `maps` needs this picture"),
        ("acquire mesh -o x.zip", "object: the sample `mesh` needs this mesh"),
        ("render -o x.png", "--object"),
        ("render --scene x.rib --object sphere -o x.png", "cannot be used with"),
        ("render --object sphere --material small.zip --world 2 -o x.png", "cannot be used with"),
        ("render --scene two.rib --world 3 -o x.png", "world: found 3, but two.rib has 2 worlds"),
        ("render --scene two.rib --shadows none -o x.png", "[possible values: all, asked]"),
        ("render --scene one.toml --shadows asked -o x.png", "shadows: only RIB scenes have this option"),
        ("render --object sphere --material small.zip -o x.jpg", "output: x.jpg does not end in .png or .exr"),
        ("render --object sphere --material small.zip -o x.png --size 0x5", "each side 1..16384"),
        ("info small.zip --encoding gamma", "encoding"),
        ("demo small.zip --components 5000 --out page", "components: none of"),
    ];
    fs::write(dir.path().join("two.rib"), "WorldBegin Sphere 1 -1 1 360 WorldEnd ".repeat(2)).unwrap();
    fs::write(dir.path().join("one.toml"), "").unwrap();
    for (line, expected) in cases {
        let message = failure(dir.path(), line, 2);
        assert!(message.contains(expected), "{line}: {message}\nshould contain {expected}");
    }
    for name in ["x.loden", "x.png", "x.zip"] {
        assert!(!dir.path().join(name).exists());
    }
}

#[test]
fn bad_files_have_code_1_and_are_named() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --method pvmf -o good.loden --components 2");
    let zip = fs::read(at.join("small.zip")).unwrap();
    fs::write(at.join("cut.zip"), &zip[..zip.len() / 2]).unwrap();
    fs::write(at.join("empty.loden"), "").unwrap();
    let good = fs::read(at.join("good.loden")).unwrap();
    fs::write(at.join("cut.loden"), &good[..good.len() - 5]).unwrap();
    let mut huge = good.clone();
    huge[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    fs::write(at.join("huge.loden"), huge).unwrap();
    fs::write(at.join("note.txt"), "hello").unwrap();
    let cases = [
        ("info cut.zip", "cut.zip: zip directory: "),
        ("info empty.loden", "empty.loden: "),
        ("info cut.loden", "cut.loden: "),
        ("info huge.loden", "huge.loden: "),
        ("decompress small.zip -o x.zip", "small.zip: is not a .loden file"),
        ("info note.txt", "note.txt: not recognised as any of: factored, loden, carrier, raw, "),
        ("info nowhere.zip", "nowhere.zip: No such file"),
        ("compare small.zip good.loden note.txt", "note.txt: "),
        ("render --object bowl.obj --material good.loden -o x.png", "bowl.obj"),
        ("render --scene note.txt -o x.png", "note.txt: expected a scene file ending in"),
        ("render --scene nowhere.rib -o x.png", "nowhere.rib: "),
        ("render --object sphere --material good.loden --env note.txt -o x.png", "note.txt: "),
        ("compress small.zip -o nowhere/x.loden", "nowhere/x.loden: cannot be written: there is no folder nowhere"),
        ("compress small.zip -o note.txt/x.loden", "note.txt/x.loden: cannot be written: note.txt is not a folder"),
        ("acquire gravel --size 2 --spp 1 --grid 64 -o nowhere/x.zip", "nowhere/x.zip: "),
        ("decompress good.loden -o small", "small exists already; --force replaces it"),
        ("decompress good.loden -o x.tar", "x.tar: no BTF format has this extension"),
    ];
    for (line, expected) in cases {
        let message = failure(at, line, 1);
        assert!(message.contains(expected), "{line}: {message}\nshould contain {expected}");
    }
}

#[test]
#[cfg(unix)]
fn a_full_disk_leaves_nothing_behind() {
    let dir = workshop();
    json(dir.path(), "compress small.zip --method pvmf -o good.loden --components 2");
    let before = fs::read_dir(dir.path()).unwrap().count();
    let lines = [
        "compress small.toml --method pvmf -o x.loden --precision f32 --components 20",
        "decompress good.loden -o x.zip --png",
        "decompress good.loden -o x.toml",
        "decompress good.loden -o folder --quality 100",
        "render --object sphere --material good.loden --size 64 --spp 1 -o x.exr",
    ];
    for line in lines {
        // with the signal ignored, a file that grows beyond the limit is an error as a full disk is
        let script = format!("trap '' XFSZ; ulimit -f 1; exec {LODEN} {line}");
        let output = Command::new("bash").args(["-c", &script]).current_dir(dir.path()).output().unwrap();
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{line}: {message}");
        let name = line.split_once("-o ").unwrap().1.split(' ').next().unwrap().replace(".toml", ".f32");
        assert!(message.contains(&name) && message.contains("File too large"), "{line}: {message}");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), before, "{line} left something behind");
    }
}

#[test]
fn an_existing_output_survives_a_failure() {
    let dir = workshop();
    let at = dir.path();
    fs::write(at.join("x.loden"), "precious").unwrap();
    failure(at, "compress small.zip --method kmeans -o x.loden --max-error 1e-9 --force", 2);
    assert_eq!(fs::read_to_string(at.join("x.loden")).unwrap(), "precious");
    json(at, "compress small.zip --method pvmf -o x.loden --components 2");
    assert_ne!(fs::read(at.join("x.loden")).unwrap(), b"precious");
}

#[test]
fn any_material_is_evaluated_at_listed_directions() {
    let dir = workshop();
    let at = dir.path();
    fs::write(at.join("x.brdf"), "2\n500 600\n0.5 0 0.5 3.14159265 0.25 0.25\n0.3 0 0.5 1 0.25 0.25\n").unwrap();
    fs::write(at.join("q.csv"), "theta_i,phi_i,theta_o,phi_o\n30,0,30,180\n0,0,60,10\n").unwrap();
    let result = json(at, "eval x.brdf --queries q.csv -o out.csv");
    assert_eq!((&result["rows"], &result["quantity"]), (&Value::from(2), &Value::from("f_r in 1/sr")));
    let text = fs::read_to_string(at.join("out.csv")).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("theta_i,phi_i,theta_o,phi_o,r,g,b"));
    let numbers: Vec<f32> = lines.next().unwrap().split(',').map(|w| w.parse().unwrap()).collect();
    assert_eq!(numbers[..4], [30.0, 0.0, 30.0, 180.0]);
    assert!(numbers[4..].iter().all(|v| (v - 0.25).abs() < 1e-4), "a grey spectrum is grey: {text}");
    json(at, "eval x.brdf --queries q.csv -o out.csv --spectral");
    let text = fs::read_to_string(at.join("out.csv")).unwrap();
    assert!(text.starts_with("theta_i,phi_i,theta_o,phi_o,500nm,600nm\n30,0,30,180,"), "{text}");
    let row: Vec<f32> = text.lines().nth(1).unwrap().split(',').map(|w| w.parse().unwrap()).collect();
    assert!(row.len() == 6 && row[4..].iter().all(|v| (v - 0.25).abs() < 1e-4), "{text}");
    let info = json(at, "info x.brdf");
    assert_eq!(
        (&info["kind"], &info["samples"], &info["negative"]),
        (&Value::from("cornell"), &Value::from(2), &Value::from(0))
    );
    // a BTF and its compressed form at a sampled pair and the centre of a texel
    fs::write(at.join("t.csv"), "40,60,0,0,0.125,0.875\n").unwrap();
    json(at, "compress small.zip --method pvmf --components 21 --precision f32 -o x.loden");
    let [raw, packed] = ["small.zip", "x.loden"].map(|name| {
        json(at, &format!("eval {name} --queries t.csv -o out.csv"));
        let text = fs::read_to_string(at.join("out.csv")).unwrap();
        let row: Vec<f32> = text.lines().nth(1).unwrap().split(',').map(|w| w.parse().unwrap()).collect();
        row[6..].to_vec()
    });
    let source = loden::import::open(at.join("small.zip"), &Default::default()).unwrap();
    let Texels::U8(image) = source.image(0, 2).unwrap() else { panic!() };
    for c in 0..3 {
        let expected = Encoding::Srgb.decode(f32::from(image[3 * (12 + 1) + c]) / 255.0);
        assert!((raw[c] - expected).abs() < 1e-4 && (packed[c] - expected).abs() < 1e-3, "{raw:?} {packed:?}");
    }
    for (text, expected) in
        [("30,0\n", "line 1: 2 numbers"), ("95,0,0,0\n", "polar angles 95"), ("1,1,1,1\nx\n", "line 2")]
    {
        fs::write(at.join("bad.csv"), text).unwrap();
        let message = failure(at, "eval x.brdf --queries bad.csv -o no.csv", 1);
        assert!(message.contains("bad.csv") && message.contains(expected), "{message}");
    }
    assert!(failure(at, "eval small.zip --queries t.csv -o no.csv --spectral", 2).contains("spectral"));
    assert!(!at.join("no.csv").exists());
}

#[test]
fn a_model_is_evaluated_and_fitted_to_a_table() {
    let dir = tempfile::tempdir().unwrap();
    let at = dir.path();
    let pair = |i: usize| format!("{},{},{},{}", i % 8 * 10, 0, i / 8 % 8 * 10 + 3, i / 64 * 45);
    let queries: Vec<String> = (0..512).map(pair).collect();
    fs::write(at.join("q.csv"), format!("theta_i,phi_i,theta_o,phi_o\n{}\n", queries.join("\n"))).unwrap();
    json(at, "brdf eval phong --set exponent=17 --set kd=0.2,0.1,0 --set ks=0.3 --queries q.csv -o out.csv");
    let out = fs::read_to_string(at.join("out.csv")).unwrap();
    let rows: Vec<&str> = out.lines().skip(1).collect();
    assert_eq!((rows.len(), out.lines().next()), (512, Some("r,g,b,pdf")));
    // theta 0 and 3 degrees
    let first: Vec<f64> = rows[0].split(',').map(|v| v.parse().unwrap()).collect();
    let expected = 0.2 / std::f64::consts::PI + 0.3 * 19.0 / std::f64::consts::TAU * 3f64.to_radians().cos().powi(17);
    assert!((first[0] - expected).abs() < 1e-12, "{} {expected}", first[0]);
    let table: Vec<String> =
        queries.iter().zip(&rows).map(|(q, v)| format!("{q},{}", v.rsplit_once(',').unwrap().0)).collect();
    fs::write(at.join("table.csv"), table.join("\n")).unwrap();
    let fit = json(at, "fit table.csv --model phong --anisotropic false");
    let found = fit["fits"][0]["params"]["exponent"].as_f64().unwrap();
    assert!((found - 17.0).abs() < 0.01, "{fit}");
    let ranked = json(at, "fit table.csv --model all --starts 1 --spheres row.png --polar row.svg");
    // Lafortune's model contains Phong's
    let best: Vec<&str> = (0..2).map(|i| ranked["fits"][i]["model"].as_str().unwrap()).collect();
    assert!(best.contains(&"phong") && best.contains(&"lafortune"), "{best:?}");
    assert!(at.join("row.png").exists() && at.join("row.svg").exists());
}

#[test]
fn brdfs_are_compared_with_each_other() {
    let (dir, table) = (workshop(), |factor: f64| {
        let row = |i: u32| {
            let [light, view, turn] = [i % 4, i / 4 % 4, i / 16].map(|k| f64::from(k) * 0.35);
            format!("{light},0,{view},{turn},{0},{0},{0}", factor * (1.0 + light + view))
        };
        format!("VARS theta_i,phi_i,theta_s,phi_s,R,G,B\n{}\n", (0..64).map(row).collect::<Vec<_>>().join("\n"))
    });
    let at = dir.path();
    fs::write(at.join("a.astm"), table(0.1)).unwrap();
    fs::write(at.join("b.astm"), table(0.11)).unwrap();
    let rows = json(at, "compare a.astm b.astm a.astm");
    assert_eq!(keys(&rows[0]), ["file", "kind", "samples", "relative_error", "largest_error"]);
    let error = |i: usize| rows[i]["relative_error"].as_f64().unwrap();
    assert!((error(0) - 0.1).abs() < 1e-4 && error(1) < 1e-6, "{rows}");
    assert!(failure(at, "compare a.astm small.zip", 1).contains("small.zip"));
    assert!(failure(at, "compare small.zip a.astm", 1).contains("a.astm"));
}

#[test]
fn a_report_compares_methods_of_synthesis() {
    let dir = workshop();
    let at = dir.path();
    let rows = json(at, "synthesize small.zip --size 24 --methods optimise,tiling --report methods");
    assert_eq!((&rows[0]["method"], &rows[1]["method"]), (&"optimise".into(), &"tiling".into()), "{rows}");
    assert!(rows[0]["measures"]["evenness"].as_f64().unwrap() > 0.0, "{rows}");
    let page = fs::read_to_string(at.join("methods/index.html")).unwrap();
    assert_eq!(page.matches("<img").count(), 3 + 2 * 4);
    assert!(failure(at, "synthesize small.zip --size 24 --report methods", 1).contains("methods"));
}

#[test]
fn a_larger_material_is_a_material_like_any_other() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --method pvmf --components 3 -o a.loden");
    for store in ["map", "planes"] {
        let made = json(at, &format!("synthesize a.loden --size 20x9 --store {store} --map m.exr -o {store}.loden"));
        assert_eq!((&made["width"], &made["height"], &made["store"]), (&20.into(), &9.into(), &store.into()));
        let info = json(at, &format!("info {store}.loden"));
        assert_eq!(
            (&info["width"], &info["height"], &info["method"]),
            (&20.into(), &9.into(), &"pvmf".into()),
            "{info}"
        );
    }
    // both hold the same images
    let compared = json(at, "compare map.loden planes.loden");
    assert!(compared[0]["max_abs_error"].as_f64().unwrap() < 1e-6, "{compared}");
    json(at, "render --object sphere --material map.loden --size 8 --spp 1 -o s.png");
    json(at, "convert map.loden large.zip");
    json(at, "decompress map.loden --parts parts");
    let again = json(at, "synthesize map.loden --size 30 --tileable --method wei-levoy -o again.loden");
    assert!(again["growth"].as_f64().unwrap() > 0.5 && again["tileable"] == true, "{again}");
    json(at, "synthesize again.loden --size 10 --store planes -o planes-again.loden");
    // what is not compressed is compressed first; pictures keep their kind
    json(at, "synthesize small.zip --size 16 --threads 1 -o one.loden");
    json(at, "synthesize small.zip --size 16 --threads 2 -o two.loden");
    assert!(fs::read(at.join("one.loden")).unwrap() == fs::read(at.join("two.loden")).unwrap());
    image::RgbaImage::from_fn(12, 12, |x, y| image::Rgba([x as u8, 20 * y as u8, 7, 9]))
        .save(at.join("p.png"))
        .unwrap();
    let made = json(at, "synthesize --image p.png --size 20x9 --seed 5 --method patches --map p-map.png -o q.png");
    assert!(made["store"].is_null() && made["seed"] == 5, "{made}");
    json(at, "synthesize p.png --apply p-map.png -o r.png");
    assert!(fs::read(at.join("q.png")).unwrap() == fs::read(at.join("r.png")).unwrap());
    assert!(matches!(image::open(at.join("q.png")).unwrap(), image::DynamicImage::ImageRgba8(_)));
    let mask = |x: u32, y: u32| image::Luma([if (4..7).contains(&x) && y < 3 { 0 } else { 255u8 }]);
    image::GrayImage::from_fn(12, 12, mask).save(at.join("mask.png")).unwrap();
    let filled = json(at, "synthesize a.loden --mask mask.png --fill -o filled.loden");
    assert_eq!((&filled["width"], &filled["method"]), (&12.into(), &"optimise".into()));
    json(at, "synthesize --image p.png --mask mask.png --fill --method efros-leung --window 5 -o filled.png");
    let (before, after) = (image::open(at.join("p.png")).unwrap(), image::open(at.join("filled.png")).unwrap());
    let differ = before.as_bytes().chunks(4).zip(after.as_bytes().chunks(4)).filter(|(a, b)| a != b).count();
    assert!((1..=9).contains(&differ), "{differ}");
    let both = json(at, "synthesize a.loden --with small.zip:3 --size 20 -o both.loden");
    assert_eq!((&both["width"], &json(at, "info both.loden")["width"]), (&20.into(), &20.into()));
    assert!(failure(at, "synthesize a.loden --with small.zip:0 --size 20 -o x.loden", 2).contains("above zero"));
    image::GrayImage::from_fn(30, 20, |x, _| image::Luma([if x < 15 { 10 } else { 240u8 }]))
        .save(at.join("g.png"))
        .unwrap();
    json(at, "synthesize a.loden --size 30x20 --guide g.png -o guided.loden");
    let error = failure(at, "synthesize a.loden --size 30 --guide g.png -o x.loden", 1);
    assert!(error.contains("g.png: size: found 30 x 20, the result has 30 x 30"), "{error}");
    let error = failure(at, "synthesize a.loden --size 30x20 --guide g.png --method tiling -o x.loden", 2);
    assert!(error.contains("method: tiling cannot follow a guide, expected optimise"), "{error}");
    let error = failure(at, "synthesize large.zip --size 9 --mask mask.png -o x.loden", 1);
    assert!(error.contains("mask.png: size: found 12 x 12, the sample has 20 x 9"), "{error}");
    assert!(failure(at, "synthesize ward --size 8 -o x.loden", 1).contains("holds a BRDF"));
    let error = failure(at, "synthesize a.loden --size 16384 --method tiling -o x.loden", 1);
    assert!(error.contains("numbers in a decoded view"), "{error}");
}

#[test]
fn a_material_covers_a_mesh_and_goes_on_without_end() {
    let dir = workshop();
    let at = dir.path();
    json(at, "compress small.zip --method pvmf --components 3 -o a.loden");
    let octahedron = "v 1 0 0\nv -1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nv 0 0 -1\nf 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\n\
                      f 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n";
    fs::write(at.join("o.obj"), octahedron).unwrap();
    let made = json(at, "synthesize a.loden --on o.obj --size 96 --stroke 0.3,0.3,0.3,1,-1,0 -o o.loden");
    assert_eq!((&made["singularities"], &made["mesh"]), (&2.into(), &"o.glb".into()), "{made}");
    assert!(made["points"].as_u64().unwrap() > 96 * 96 / 5, "{made}");
    assert_eq!(json(at, "info o.loden")["width"], 96);
    json(at, "render --object o.glb --material o.loden --uv-scale 1 --size 8 --spp 1 -o o.png");
    fs::write(at.join("book.obj"), octahedron.to_owned() + "v 2 2 2\nf 1 3 7\n").unwrap();
    let error = failure(at, "synthesize a.loden --on book.obj --size 96 -o x.loden", 1);
    assert!(error.contains("book.obj: mesh: 3 triangles meet at the edge from [1, 0, 0] to [0, 1, 0]"), "{error}");
    assert!(failure(at, "synthesize a.loden --on o.obj --size 96x64 -o x.loden", 2).contains("an atlas is square"));
    json(at, "render --object sphere --material a.loden --endless --size 8 --spp 1 -o endless.png");
    assert!(failure(at, "render --object sphere --material ward --endless -o x.png", 1).contains("holds a BRDF"));
}

#[test]
fn wrong_models_and_methods_are_explained() {
    let dir = tempfile::tempdir().unwrap();
    let at = dir.path();
    fs::write(at.join("q.csv"), "1,2,3\n").unwrap();
    let cases = [
        ("fit ward --model wart", 2, "invalid value 'wart' for '--model <MODEL>'"),
        ("fit ward --lobes 4 --model lafortune", 2, "lobes: found \"4\""),
        ("fit ward --set form=ward", 2, "form: can be set for one model only"),
        ("synthesize x.zip --size 8 --method weaving -o x.loden", 2, "invalid value 'weaving' for '--method <METHOD>'"),
        ("synthesize x.zip --size 8 --method tiling --block 4 -o x.loden", 2, "block: no such parameter"),
        ("synthesize x.zip --size 8x0 -o x.loden", 2, "invalid value '8x0' for '--size <SIZE>'"),
        ("synthesize x.zip -o x.loden", 2, "--size <SIZE>"),
        ("synthesize x.zip --size 20000 -o x.loden", 2, "invalid value '20000' for '--size <SIZE>'"),
        ("synthesize x.zip --size 8 -o x.png", 2, "x.png does not end in .loden"),
        ("synthesize q.csv --apply q.csv -o x.png", 1, "q.csv: PNG: "),
        ("factor ward --method qr -o x", 2, "invalid value 'qr' for '--method <METHOD>'"),
        ("factor ward --method nd --terms 2 -o x", 2, "terms: no such parameter"),
        ("factor ward:alpha-x=9 --method nd -o x", 2, "alpha-x: found \"9\", expected a number from 0.001 to 2"),
        ("brdf plot ward --lights 95 -o x", 2, "lights: found 95"),
        ("brdf eval ward --queries q.csv -o x.csv", 1, "q.csv: line 1: found \"1,2,3\", expected 4 numbers"),
        ("brdf spheres nowhere.bsdf -o x.png", 1, "nowhere.bsdf: No such file"),
    ];
    for (line, code, expected) in cases {
        let message = failure(at, line, code);
        assert!(message.contains(expected), "{line}: {message}\nshould contain {expected}");
    }
    assert!(!at.join("x").exists() && !at.join("x.csv").exists());
}
