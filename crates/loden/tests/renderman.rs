//! Materials exported to RenderMan: shaders whose names are all of the language, pictures that equal ours, scenes that are read again.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Mat4, Vec3};
use loden::btf::BtfSource;
use loden::codec::{self, parts};
use loden::import::{self, Measured};
use loden::job::export_to;
use loden::params::Given;
use loden::picture::Picture;
use loden::progress::Silent;
use loden::render::render;
use loden::render::scene_file::SceneFile;
use loden::renderers::{self, scene};

use crate::rsl::machine::{Machine, Point, Texture, Value};
use crate::rsl::{parse, resolve};
use crate::shaders::{compressed, sample};

/// Angles of the light from the direction of the camera, degrees.
const LIGHTS: [f32; 3] = [15.0, 45.0, 75.0];

/// Side of the pictures, of which every 8th pixel of every 8th row is compared.
const SIDE: usize = 128;
const STEP: usize = 8;

/// Mean absolute difference, as a fraction of full scale.
const TOLERANCE: f32 = 0.004;

/// The folder of an export with these options, without the picture of the test scene.
fn exported(file: &Path, folder: &Path, given: &Given) -> PathBuf {
    let out = folder.join(file.file_stem().unwrap());
    fs::create_dir(&out).unwrap();
    let renderer = renderers::by_name("renderman").unwrap();
    let renderer = renderer.with(&given.values(renderer.params()).unwrap()).unwrap().unwrap();
    let material = codec::open(file).unwrap();
    renderer.check(file, &material).unwrap();
    renderer.write("gravel", &material, &out, &Silent).unwrap();
    out
}

/// A small sample, compressed by a method.
fn material(method: &str, folder: &Path) -> PathBuf {
    let inner = folder.join(format!("measured-{method}"));
    fs::create_dir(&inner).unwrap();
    let file = inner.join(format!("{method}.loden"));
    compressed(&*sample(&inner), method, &[], &file);
    file
}

/// The only file of a folder with an ending.
fn of_ending(folder: &Path, ending: &str) -> PathBuf {
    let mut files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files.find(|path| path.extension().is_some_and(|other| other == ending)).unwrap()
}

/// The textures of a folder. They are TIFF files of one strip, in the order of bytes of this machine, as the exporter writes them.
fn textures(folder: &Path) -> HashMap<String, Texture> {
    let mut found = HashMap::new();
    for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if path.extension().is_some_and(|ending| ending == "tif") {
            let bytes = fs::read(&path).unwrap();
            let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
            let directory = word(4);
            let entries = usize::from(bytes[directory]);
            let tag = |wanted: u16| {
                let at =
                    (0..entries).map(|k| directory + 2 + 12 * k).find(|&at| bytes[at..at + 2] == wanted.to_le_bytes());
                word(at.unwrap_or_else(|| panic!("{}: no tag {wanted}", path.display())) + 8)
            };
            let (width, height, start, length) = (tag(256), tag(257), tag(273), tag(279));
            let pixels = &bytes[start..start + length];
            let numbers: Vec<f32> = if bytes[tag(339)] == 3 {
                pixels.chunks_exact(4).map(|four| f32::from_le_bytes(four.try_into().unwrap())).collect()
            } else {
                pixels.iter().map(|&byte| f32::from(byte) / 255.0).collect()
            };
            assert_eq!(numbers.len(), 4 * width * height);
            found.insert(path.file_name().unwrap().to_str().unwrap().to_owned(), Texture { width, height, numbers });
        }
    }
    found
}

/// Towards a light at an angle from the camera.
fn sun(angle: f32) -> Vec3 {
    let [right, up, forward] = scene::axes();
    let side = (0.9 * right + 0.4 * up).normalize();
    angle.to_radians().cos() * -forward + angle.to_radians().sin() * side
}

/// From world space to that of RenderMan's camera.
fn camera_from_world() -> Mat4 {
    let [right, up, forward] = scene::axes();
    Mat4::from_cols(right.extend(0.0), up.extend(0.0), forward.extend(0.0), glam::Vec4::W).transpose()
        * Mat4::from_translation(-scene::EYE)
}

/// The point of the ball behind a pixel, seen under a cosine of at least `cosine`; light from a direction.
fn point(x: usize, y: usize, light: Vec3, cosine: f32) -> Option<Point> {
    let [right, up, forward] = scene::axes();
    let half = (0.5 * scene::FIELD_OF_VIEW.to_radians()).tan();
    let at = |k: usize| (k as f32 + 0.5) / SIDE as f32 * 2.0 - 1.0;
    let ray = (forward + half * (at(x) * right - at(y) * up)).normalize();
    let (b, c) = (scene::EYE.dot(ray), scene::EYE.length_squared() - 1.0);
    let root = b * b - c;
    let p = scene::EYE + ray * (-b - root.max(0.0).sqrt());
    if root <= 0.0 || p.dot(ray) > -cosine {
        return None;
    }
    let around = p.y.atan2(p.x).rem_euclid(std::f32::consts::TAU) / std::f32::consts::TAU;
    let height = p.z.asin() / std::f32::consts::PI + 0.5;
    let dpdu = Vec3::new(-p.y, p.x, 0.0) * std::f32::consts::TAU;
    let along = Vec3::new(-p.z * p.x, -p.z * p.y, 1.0 - p.z * p.z);
    let dpdv = along / along.length() * std::f32::consts::PI;
    let camera = camera_from_world();
    let vector = |v: Vec3| camera.transform_vector3(v);
    Some(Point {
        position: camera.transform_point3(p),
        normal: vector(2.0 * p),
        incident: vector(ray * 4.0),
        dpdu: vector(dpdu),
        dpdv: vector(dpdv),
        s: [2.0 * around, 2.0, 0.0],
        t: [1.0 - height, 0.0, -1.0],
        lights: vec![(vector(light), Vec3::ONE)],
    })
}

/// Our picture of the exported scene with another light and other parameters of the surface.
fn ours(folder: &Path, light: Vec3, surface: &str) -> Picture {
    let text = fs::read_to_string(folder.join("scene.rib")).unwrap();
    let from = text.find("\"point from\" [").unwrap() + 13;
    let to = from + text[from..].find(']').unwrap() + 1;
    let text = format!("{}[{} {} {}]{}", &text[..from], light.x, light.y, light.z, &text[to..]);
    let path = folder.join("other.rib");
    fs::write(&path, text.replace("\"scale\" [4]", &format!("\"scale\" [4] {surface}"))).unwrap();
    let mut file = SceneFile::open(&path).unwrap();
    // nothing but what is no part of the picture
    let known = ["Display", "Quantize", "PixelSamples", "PixelFilter", "searchpath"];
    assert!(file.warnings.iter().all(|warning| known.iter().any(|word| warning.contains(word))), "{:?}", file.warnings);
    (file.settings.width, file.settings.height, file.settings.spp) = (SIDE, SIDE, 4);
    render(&file.scene(), &file.settings, &Silent).unwrap()
}

/// Compares the shader of a folder with our pictures, and returns how many looks into textures a point takes.
pub fn compare(folder: &Path, lights: &[f32], surface: &str, given: &[(&str, Value)]) -> usize {
    let shader = parse::parse(&fs::read_to_string(of_ending(folder, "sl")).unwrap());
    resolve(&shader);
    assert_eq!(of_ending(folder, "sl").file_stem().unwrap().to_str(), Some(&*shader.name));
    let textures = textures(folder);
    let mut values = vec![("scale", Value::Float(scene::REPEATS))];
    values.extend(given.iter().cloned());
    let machine = Machine::new(&shader, &textures, camera_from_world(), &values);
    let mut points = 0;
    for &angle in lights {
        let light = sun(angle);
        let picture = ours(folder, light, surface);
        let (mut difference, mut sum, mut count) = (0.0, 0.0, 0);
        for (x, y) in (0..SIDE * SIDE).step_by(STEP).map(|k| (k % SIDE, k / SIDE)).filter(|(_, y)| y % STEP == 0) {
            let Some(point) = point(x, y, light, 0.5) else { continue };
            let (found, expected) = (machine.color(&point), picture.at(x, y));
            difference += (found - expected).abs().element_sum() / 3.0;
            sum += expected.element_sum() / 3.0;
            count += 1;
        }
        let (difference, mean) = (difference / count as f32, sum / count as f32);
        println!(
            "{}, {angle} degrees {surface}: {count} pixels of mean {mean:.4} differ by {difference:.5}",
            folder.display()
        );
        assert!(count > 40 && mean > 0.01 && difference < TOLERANCE, "{}", folder.display());
        points += count;
    }
    machine.looks.get() / points
}

#[test]
fn a_renderman_shader_gives_our_pictures() {
    let folder = tempfile::tempdir().unwrap();
    for method in ["pvmf", "klt", "median-cut"] {
        let file = &material(method, folder.path());
        let out = exported(file, folder.path(), &Given::default());
        compare(&out, &LIGHTS, "", &[]);
        if method == "pvmf" {
            compare(&out, &[45.0], "\"rotation\" [-50]", &[("rotation", Value::Float(-50.0))]);
        }
    }
    let ward = folder.path().join("ward");
    let brdf = Path::new("ward:alpha-x=0.2:alpha-y=0.5:kd=0.2,0.1,0.05:ks=0.2");
    export_to(brdf, &Given::default(), renderers::by_name("renderman").unwrap(), &ward, &Silent).unwrap();
    compare(&ward, &LIGHTS, "", &[]);
}

#[test]
fn the_carrier_gives_the_same_pictures_and_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let carrier = Given::default().with("textures", "carrier");
    for method in ["pvmf", "median-cut"] {
        let file = &material(method, folder.path());
        let out = exported(file, folder.path(), &carrier);
        compare(&out, &[45.0], "", &[]);
        let (parts, _) = parts::folder::read_folder(&out).unwrap();
        let read = codec::Decoded::new(Arc::new(parts)).unwrap();
        let stored = codec::open(file).unwrap();
        let (importer, opened) = import::open_named(&out, &Given::default()).unwrap();
        assert!(importer.name() == "carrier" && matches!(opened, Measured::Btf(_)));
        let mut largest = 0.0f32;
        for (view, light) in [(0, 0), (40, 17), (80, 80)] {
            let [a, b] = [stored.image(view, light).unwrap(), read.image(view, light).unwrap()];
            largest = a.to_f32().iter().zip(b.to_f32().iter()).fold(largest, |most, (a, b)| most.max((a - b).abs()));
        }
        // the block image has 8 bits
        let most = if method == "pvmf" { 1e-6 } else { 0.5 / 255.0 + 1e-6 };
        assert!(largest <= most, "{method}: {largest}");
    }
    let klt = &material("klt", folder.path());
    let renderer = renderers::by_name("renderman").unwrap();
    let error = export_to(klt, &carrier, renderer, &folder.path().join("klt"), &Silent).unwrap_err().to_string();
    assert!(error.contains("klt.loden") && error.contains("carrier"), "{error}");
}

#[test]
fn a_split_adds_up_to_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let file = &material("pvmf", folder.path());
    let out = exported(file, folder.path(), &Given::default().with("split", "yes"));
    let shader = parse::parse(&fs::read_to_string(of_ending(&out, "sl")).unwrap());
    let textures = textures(&out);
    let machine = |least: f32, most: f32| {
        let range =
            [("scale", 4.0), ("least", least), ("most", most)].map(|(name, number)| (name, Value::Float(number)));
        Machine::new(&shader, &textures, camera_from_world(), &range)
    };
    let [whole, near, middle, far] = [[0.0, 91.0], [0.0, 45.0], [45.0, 60.0], [60.0, 91.0]].map(|[a, b]| machine(a, b));
    let mut seen = [0; 3];
    for x in (0..SIDE).step_by(3) {
        let Some(point) = point(x, SIDE / 2, sun(30.0), 0.2) else { continue };
        let colors = [&near, &middle, &far].map(|machine| machine.color(&point));
        (0..3).for_each(|k| seen[k] += usize::from(colors[k] != Vec3::ZERO));
        assert_eq!(colors.iter().filter(|color| **color != Vec3::ZERO).count(), 1);
        assert_eq!(colors.iter().sum::<Vec3>(), whole.color(&point));
    }
    assert!(seen.iter().all(|&count| count > 0), "{seen:?}");
    for least in [0, 45, 60] {
        let text = fs::read_to_string(out.join(format!("scene_{least}.rib"))).unwrap();
        assert!(text.contains(&format!("\"least\" [{least}]")));
    }
}

/// The mean over blocks of pixels: noise is averaged, differences of a scene are not.
fn blocks(picture: &Picture, size: usize) -> Vec<Vec3> {
    let place = |k: usize| (k % (picture.width / size) * size, k / (picture.width / size) * size);
    let mean =
        |(x, y)| (0..size * size).map(|k| picture.at(x + k % size, y + k / size)).sum::<Vec3>() / (size * size) as f32;
    (0..picture.width / size * (picture.height / size)).map(|k| mean(place(k))).collect()
}

#[test]
fn scenes_are_written_as_rib_and_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    for name in ["cornell-box.toml", "light-bulb.toml", "teapot.toml", "teapot.rib"] {
        let original = scenes.join(name);
        let written = SceneFile::open(&original).unwrap();
        let surfaces: Vec<String> = written
            .materials
            .iter()
            .map(|material| format!("Surface \"loden\" \"string material\" [{:?}]", material.source.as_ref().unwrap()))
            .collect();
        let text = written.to_rib(&surfaces).unwrap();
        let path = folder.path().join(format!("{name}.rib"));
        fs::write(&path, text).unwrap();
        let again = SceneFile::open(&path).unwrap();
        assert_eq!(again.bodies.len(), written.bodies.len());
        let picture = |mut file: SceneFile| {
            (file.settings.width, file.settings.height, file.settings.spp) = (48, 36, 32);
            file.settings.depth = 3;
            render(&file.scene(), &file.settings, &Silent).unwrap()
        };
        let [a, b] = [written, again].map(picture).map(|picture| blocks(&picture, 6));
        let mean = a.iter().sum::<Vec3>().element_sum() / (3 * a.len()) as f32;
        let difference: f32 =
            a.iter().zip(&b).map(|(a, b)| (*a - *b).abs().element_sum() / 3.0).sum::<f32>() / a.len() as f32;
        println!("{name}: mean {mean:.4}, blocks differ by {difference:.5}");
        assert!(mean > 0.02 && difference < 0.02 * mean, "{name}: {difference} of {mean}");
    }
}

#[test]
fn a_scene_is_exported_with_its_materials() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene.toml");
    let pvmf = &material("pvmf", folder.path());
    let text = format!(
        r#"
size = [64, 64]
[camera]
position = [0, -5, 2]
target = [0, 0, 0]
up = [0, 0, 1]
field-of-view = 28
[material.gravel]
file = {pvmf:?}
[material.satin]
model = "ward"
alpha-x = 0.2
alpha-y = 0.5
[material.paper]
model = "lambert"
kd = [0.5, 0.4, 0.3]
[[light]]
kind = "directional"
direction = [-0.5, -0.6, 0.6244998]
irradiance = 3
[[shape]]
kind = "sphere"
material = "gravel"
uv-scale = 4
uv-rotation = 20
[[shape]]
kind = "torus"
major-radius = 1.2
minor-radius = 0.15
material = "satin"
transform = [{{ rotate = [20, 1, 0, 0] }}]
[[shape]]
kind = "quad"
corners = [[-3, -3, -1.2], [3, -3, -1.2], [3, 3, -1.2], [-3, 3, -1.2]]
material = "paper"
"#
    );
    fs::write(&scene, text).unwrap();
    let out = folder.path().join("out");
    let renderer = renderers::by_name("renderman").unwrap();
    export_to(&scene, &Given::default(), renderer, &out, &Silent).unwrap();
    let rib = fs::read_to_string(out.join("scene.rib")).unwrap();
    assert!(rib.contains("Surface \"matte\"") && rib.matches("Surface \"loden_").count() == 2, "{rib}");
    for entry in fs::read_dir(&out).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.extension().is_some_and(|ending| ending == "sl") {
            resolve(&parse::parse(&fs::read_to_string(entry).unwrap()));
        }
    }
    let picture = |path: &Path| {
        let mut file = SceneFile::open(path).unwrap();
        (file.settings.width, file.settings.height, file.settings.spp, file.settings.depth) = (48, 48, 64, 2);
        blocks(&render(&file.scene(), &file.settings, &Silent).unwrap(), 4)
    };
    let (a, b) = (picture(&scene), picture(&out.join("scene.rib")));
    let difference = a.iter().zip(&b).map(|(a, b)| (*a - *b).abs().element_sum() / 3.0).sum::<f32>() / a.len() as f32;
    assert!(difference < 0.002, "{difference}");
    let other = renderers::by_name("glsl").unwrap();
    let error =
        export_to(&scene, &Given::default(), other, &folder.path().join("glsl"), &Silent).unwrap_err().to_string();
    assert!(error.contains("scene.toml") && error.contains("glsl"), "{error}");
}
