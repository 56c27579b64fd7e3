//! BTF files of the Bonn dome, light-position files and image sets: values agree with independent ones.

use std::f64::consts::PI;
use std::fs;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use crate::common::data;
use glam::{Vec2, Vec3};
use half::f16;
use loden::btf::{BtfSource, Cosine, SampleType};
use loden::color::Encoding;
use loden::direction::{DirectionSet, Scheme};
use loden::import;
use loden::material::{Material, RawBtf};
use loden::params::Given;
use loden::picture::Picture;

fn open(path: impl AsRef<Path>) -> Arc<dyn BtfSource> {
    import::open(path, &Default::default()).unwrap()
}

fn nearest(set: &DirectionSet, theta: f64, phi: f64) -> usize {
    let same =
        |d: &[f64; 2]| (d[0] - theta).abs() < 1e-3 && (theta == 0.0 || (d[1] - phi.rem_euclid(360.0)).abs() < 1e-3);
    set.degrees().iter().position(same).unwrap()
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn files_of_another_writer_decode_to_half_precision_in_both_row_orders() {
    let folder = data("oracle");
    let text = fs::read_to_string(folder.join("expected.csv")).unwrap();
    for (order, flip) in [("bottom", false), ("top", true)] {
        let mut worst = 0.0f32;
        for line in text.lines().skip(1) {
            let cells: Vec<&str> = line.split(',').collect();
            let n = |i: usize| cells[i].parse::<f64>().unwrap();
            let options = Given::from([("first-row", order)]);
            let source = import::open(folder.join(cells[0]), &options).unwrap();
            let meta = source.meta();
            let (light, view) = (nearest(&meta.lights, n(1), n(2)), nearest(&meta.views, n(3), n(4)));
            let (row, column) = (n(5) as usize, n(6) as usize);
            // expected rows count from the top of a picture, whose first row in the file is at the bottom
            let row = if flip { meta.height - 1 - row } else { row };
            let image = source.image(view, light).unwrap();
            let at = (row * meta.width + column) * 3;
            for channel in 0..3 {
                let (found, expected) = (image.to_f32()[at + channel], n(7 + channel) as f32);
                let error = (found - expected).abs();
                worst = worst.max(error);
                // half precision has 11 bits
                assert!(error <= expected.abs().max(0.25) / 1024.0, "{line}: {found}");
            }
        }
        println!("{order:?}: largest difference {worst:.2e}");
    }
    let source = open(folder.join("t_dfmf16.btf"));
    assert_eq!(source.meta().encoding, Encoding::Linear);
    let all = source.view(1).unwrap();
    let one = source.image(1, 2).unwrap();
    let len = source.meta().image_len();
    assert_eq!(all.part(2 * len..3 * len).to_f32(), one.to_f32());
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn the_dome_s_directions_are_the_set_of_that_name() {
    let folder = data("ubo2014");
    let bytes = fs::read(folder.join("bonn_angles.bin")).unwrap();
    let numbers: Vec<f64> = bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
    let set = DirectionSet::ubo2014();
    for (i, [theta, phi]) in set.degrees().iter().enumerate() {
        let (azimuth, elevation) = (numbers[i].to_degrees().rem_euclid(360.0), numbers[151 + i].to_degrees());
        assert!((90.0 - elevation - theta).abs() < 1e-3, "{i}");
        let off = (azimuth - phi).abs();
        assert!(*theta == 0.0 || off.min(360.0 - off) < 1e-3, "{i} {azimuth} {phi}");
    }
}

/// Writes the parts of a `.btf` file.
struct Btf(Vec<u8>);

const VIEWS: [[f32; 2]; 2] = [[0.0, 0.0], [0.5, 1.0]];
const LIGHTS: [[f32; 2]; 3] = [[0.0, 0.0], [0.7, 2.0], [1.0, -1.5]];
const SIZE: [usize; 2] = [4, 3];

impl Btf {
    fn new(signature: &str, version: u32) -> Self {
        let mut block = Vec::new();
        block.extend(version.to_le_bytes());
        block.extend([b'x'; 240]);
        block.extend([8.0f32, 1.0, 1.0, 1.0].iter().flat_map(|v| v.to_le_bytes()));
        if version > 1 {
            block.extend(1u32.to_le_bytes());
        }
        if version > 2 {
            block.extend(4u32.to_le_bytes());
            block.extend(b"<a/>");
        }
        if version > 3 {
            block.extend(3u32.to_le_bytes());
            for name in [b'R', b'G', b'B'] {
                block.extend(1u32.to_le_bytes());
                block.push(name);
            }
        }
        let mut file = Self(signature.as_bytes().to_vec());
        file.u32(block.len() + 4);
        file.0.extend(block);
        file.u32(VIEWS.len());
        for view in VIEWS {
            file.f32s(&view);
            file.u32(LIGHTS.len());
            LIGHTS.iter().for_each(|light| file.f32s(light));
        }
        file
    }

    fn u32(&mut self, value: usize) {
        self.0.extend((value as u32).to_le_bytes());
    }

    fn f32s(&mut self, values: &[f32]) {
        self.0.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    }

    fn size(&mut self, rotated: bool) {
        self.u32(SIZE[0]);
        self.u32(SIZE[1]);
        if rotated {
            self.u32(0);
        }
    }

    fn scalars(&mut self, size: u8, values: impl IntoIterator<Item = f32>) {
        for value in values {
            match size {
                2 => self.0.extend(f16::from_f32(value).to_le_bytes()),
                4 => self.0.extend(value.to_le_bytes()),
                _ => self.0.extend(f64::from(value).to_le_bytes()),
            }
        }
    }

    fn open(&self) -> Arc<dyn BtfSource> {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("x.btf"), &self.0).unwrap();
        open(dir.path().join("x.btf"))
    }
}

/// A function of rank 2, which two components represent exactly. Multiples of 1/64 are exact in half precision.
fn value(pair: usize, texel: usize, channel: usize) -> f32 {
    let (a, b) = ((pair as f32 + 1.0) / 8.0, (channel as f32 + 1.0) / 4.0);
    let (c, d) = (texel as f32 / 8.0, 0.5);
    a * c + b * d
}

fn direction_row(pair: usize, channel: usize) -> [f32; 2] {
    [(pair as f32 + 1.0) / 8.0, (channel as f32 + 1.0) / 4.0]
}

fn texel_row(texel: usize) -> [f32; 2] {
    [texel as f32 / 8.0, 0.5]
}

/// Checks that all images are those of [`value`], with the first row of the file at the bottom.
fn assert_values(source: &dyn BtfSource, what: &str) {
    let [width, height] = SIZE;
    assert_eq!([source.meta().width, source.meta().height], SIZE);
    for view in 0..VIEWS.len() {
        for light in 0..LIGHTS.len() {
            let image = source.image(view, light).unwrap();
            for (i, found) in image.to_f32().iter().enumerate() {
                let (x, y, channel) = (i / 3 % width, i / 3 / width, i % 3);
                let texel = (height - 1 - y) * width + x;
                let expected = value(view * LIGHTS.len() + light, texel, channel);
                assert!((found - expected).abs() < 1e-5, "{what}: {view} {light} {i}: {found} {expected}");
            }
        }
    }
}

#[test]
fn factorisations_are_read_in_every_form() {
    let (pairs, texels) = (VIEWS.len() * LIGHTS.len(), SIZE[0] * SIZE[1]);
    for (signature, version, scalar, transposed) in
        [("!DFMF08FC", 1, 2, false), ("!DFMF08FCR", 2, 4, false), ("!DFMF08FC", 3, 8, true), ("!DFMF08FCR", 4, 2, true)]
    {
        let mut file = Btf::new(signature, version);
        file.size(signature.ends_with('R'));
        file.u32(2);
        file.u32(0);
        file.f32s(&[0.0; 12]);
        for channel in 0..3 {
            file.0.push(scalar);
            file.u32(2);
            let directions = (0..pairs).flat_map(|p| direction_row(p, channel));
            let texel_rows = (0..texels).flat_map(texel_row);
            let [rows, columns] = if transposed { [texels, pairs] } else { [pairs, texels] };
            file.u32(rows);
            file.u32(columns);
            file.scalars(scalar, [1.0, 0.5]);
            if transposed {
                file.scalars(scalar, texel_rows);
                file.scalars(scalar, directions);
            } else {
                file.scalars(scalar, directions);
                file.scalars(scalar, texel_rows);
            }
        }
        let source = file.open();
        assert_values(source.as_ref(), signature);
        assert_eq!(source.meta().cosine, Cosine::Included);
        assert_eq!(source.meta().sample_type, SampleType::F32);
    }
}

#[test]
fn full_matrix_factorisations_are_read_in_every_form() {
    let (pairs, texels) = (VIEWS.len() * LIGHTS.len(), SIZE[0] * SIZE[1]);
    for (signature, transposed) in
        [("!FMF06FC", false), ("!FMF06FCR", true), ("!FMF12FCE", false), ("!FMF12FCER", false)]
    {
        let mut file = Btf::new(signature, 4);
        file.u32(SIZE[0]);
        file.u32(SIZE[1]);
        if signature.ends_with('R') {
            file.u32(1);
            file.f32s(&[0.0; 9]);
        }
        if signature.contains("FCE") {
            file.0.push(2);
            file.u32(0);
            file.u32(2);
            file.u32(3);
            file.scalars(2, [0.0; 6]);
        }
        file.u32(2);
        file.0.push(4);
        file.u32(2);
        if transposed {
            file.u32(3 * texels);
            file.u32(pairs);
            file.scalars(4, [1.0, 1.0]);
            // value = a c + b d, with the channel on the side of the texels
            file.scalars(4, (0..3 * texels).flat_map(|i| [texel_row(i / 3)[0], 0.5 * direction_row(0, i % 3)[1]]));
            file.scalars(4, (0..pairs).flat_map(|p| [direction_row(p, 0)[0], 1.0]));
        } else {
            file.u32(3 * pairs);
            file.u32(texels);
            file.scalars(4, [1.0, 1.0]);
            file.scalars(4, (0..3 * pairs).flat_map(|i| direction_row(i / 3, i % 3)));
            file.scalars(4, (0..texels).flat_map(texel_row));
        }
        assert_values(file.open().as_ref(), signature);
    }
}

#[test]
fn factorisations_per_view_are_read_with_images_or_texels_as_vectors() {
    let (lights, texels) = (LIGHTS.len(), SIZE[0] * SIZE[1]);
    for images in [true, false] {
        let mut file = Btf::new("!PVF06FC", 4);
        file.u32(SIZE[0]);
        file.u32(SIZE[1]);
        file.u32(2);
        file.u32(VIEWS.len());
        for view in 0..VIEWS.len() {
            let (count, dim) = if images { (lights, 3 * texels) } else { (texels, 3 * lights) };
            file.0.push(4);
            file.u32(1);
            file.u32(count);
            file.u32(dim);
            file.scalars(4, [1.0]);
            let constant = |channel: usize| direction_row(0, channel)[1] * 0.5;
            file.scalars(4, (0..dim).map(|i| constant(i % 3)));
            let slope = |light: usize| direction_row(view * lights + light, 0)[0];
            if images {
                file.scalars(4, (0..dim).map(|i| texel_row(i / 3)[0]));
                file.scalars(4, (0..count).map(slope));
            } else {
                file.scalars(4, (0..dim).map(|i| slope(i / 3)));
                file.scalars(4, (0..count).map(|texel| texel_row(texel)[0]));
            }
        }
        assert_values(file.open().as_ref(), &format!("PVF, images {images}"));
    }
}

#[test]
fn whole_tensors_are_read_raw_packed_and_masked() {
    let (pairs, [width, height]) = (VIEWS.len() * LIGHTS.len(), SIZE);
    for compression in [0u8, 1, 2] {
        let mut file = Btf::new("!BDIF06R2!", 4);
        file.u32(width);
        file.u32(height);
        file.u32(2);
        file.0.push(compression);
        // the third texel of the second row is masked out
        let mask: Vec<u8> = (0..width * height).map(|i| u8::from(i != width + 2)).collect();
        file.0.extend(&mask);
        file.u32(0);
        for rows in [0..2, 2..3usize] {
            let texels = (rows.start * width..rows.end * width).filter(|&t| compression != 2 || mask[t] != 0);
            let mut chunk = Btf(Vec::new());
            for texel in texels {
                chunk.scalars(2, (0..3 * pairs).map(|i| value(i / 3, texel, i % 3)));
            }
            let payload = if compression == 1 {
                let mut packer = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
                packer.write_all(&chunk.0).unwrap();
                packer.finish().unwrap()
            } else {
                chunk.0
            };
            file.u32(payload.len());
            file.0.extend(payload);
        }
        let source = file.open();
        if compression == 2 {
            let image = source.image(0, 0).unwrap().to_f32().into_owned();
            let at = (width + 2) * 3;
            assert_eq!(image[at..at + 3], [0.0; 3], "the middle row is its own mirror image");
            assert!((image[at + 3] - value(0, width + 3, 0)).abs() < 1e-5);
        } else {
            assert_values(source.as_ref(), "BDI");
        }
    }
}

#[test]
fn a_file_of_a_gigabyte_opens_at_once() {
    let mut file = Btf::new("!DFMF08FCR", 4);
    let (side, k) = (2048u64, 43);
    file.u32(side as usize);
    file.u32(side as usize);
    file.u32(0);
    file.u32(k);
    file.u32(11);
    file.f32s(&[0.0; 12]);
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("large.btf");
    let out = fs::File::create(&path).unwrap();
    // a sparse file, which takes no space on the disk
    let mut at = file.0.len() as u64;
    std::os::unix::fs::FileExt::write_all_at(&out, &file.0, 0).unwrap();
    for _ in 0..3 {
        let mut head = Btf(vec![2]);
        head.u32(k);
        head.u32(VIEWS.len() * LIGHTS.len());
        head.u32((side * side) as usize);
        std::os::unix::fs::FileExt::write_all_at(&out, &head.0, at).unwrap();
        at += head.0.len() as u64 + 2 * k as u64 * (1 + 6 + side * side);
    }
    out.set_len(at).unwrap();
    assert!(at > 1 << 30, "{at}");
    let start = Instant::now();
    let source = open(&path);
    let seconds = start.elapsed().as_secs_f64();
    println!("{at} bytes opened in {:.2} ms", seconds * 1e3);
    assert!(seconds < 0.1, "{seconds} s");
    assert_eq!(source.source_bytes(), at);
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn a_light_position_file_opens_and_is_evaluated() {
    let folder = data("rti_loewenkopf");
    let source = open(folder.join("dirs.lp"));
    let meta = source.meta();
    assert_eq!((meta.views.len(), meta.lights.len(), meta.width, meta.height), (1, 240, 64, 43));
    let [x, y, z] = [-0.0019356994f32, -0.14720464, 0.98910415];
    assert!((meta.lights.directions()[0] - Vec3::new(x, y, z)).length() < 1e-5);
    let material = RawBtf::new(source.clone(), Scheme::Triangles).unwrap();
    let lit = material.apparent(Vec2::new(0.5, 0.5), meta.lights.directions()[0], Vec3::Z);
    assert!(lit.min_element() > 0.001 && lit.max_element() < 1.0, "{lit}");
    let on_demand = RawBtf::on_demand(source.clone(), Scheme::Triangles).unwrap();
    assert_eq!(on_demand.apparent(Vec2::new(0.5, 0.5), meta.lights.directions()[0], Vec3::Z), lit);
}

#[test]
fn light_position_files_are_read_with_and_without_their_count() {
    let dir = tempfile::tempdir().unwrap();
    for (i, name) in ["a b.png", "c.png"].iter().enumerate() {
        image::RgbImage::from_pixel(2, 2, image::Rgb([40 * (i as u8 + 1); 3])).save(dir.path().join(name)).unwrap();
    }
    let lines = "a b.png 0 0 1\nc.png 0.6 0 0.8\n";
    for text in [lines.to_owned(), format!("2\n{lines}"), format!("3\n{lines}c.png 0.6 0 -0.8\n")] {
        fs::write(dir.path().join("x.lp"), &text).unwrap();
        let source = open(dir.path().join("x.lp"));
        assert_eq!(source.meta().lights.len(), 2);
        assert_eq!(source.image(0, 1).unwrap().to_f32()[0], 80.0 / 255.0);
        assert_eq!(source.warnings().len(), usize::from(text.starts_with('3')));
    }
    for (text, expected) in [
        ("4\na b.png 0 0 1\n", "number of images: 1 images, the first line says 4"),
        ("a b.png 0 0 1\nno.png 0 0 1\n", "no.png: "),
        ("a b.png 0 0 1\nx y\n", "line 2: found too few words, expected a path and three numbers"),
    ] {
        fs::write(dir.path().join("x.lp"), text).unwrap();
        let error = import::open(dir.path().join("x.lp"), &Default::default()).err().unwrap().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn light_position_files_of_other_programs_are_read() {
    let dir = tempfile::tempdir().unwrap();
    image::RgbImage::from_pixel(2, 2, image::Rgb([40; 3])).save(dir.path().join("a b.png")).unwrap();
    let path = dir.path().join("x.lp");
    for (text, warning) in [
        ("\u{feff}1\na b.png 0 0.6 0.8\n", ""),
        ("1\r\nC:\\Users\\me\\RTI\\a b.png 0 0.6 0.8\r\n", "paths do not exist"),
        ("/home/me/a b.png 0 0.6 0.8\n", "paths do not exist"),
        ("1\na b.png 0 300.0 400.0\n", "not of length 1"),
    ] {
        fs::write(&path, text).unwrap();
        let source = open(&path);
        assert!((source.meta().lights.directions()[0] - Vec3::new(0.0, 0.6, 0.8)).length() < 1e-6, "{text}");
        assert_eq!(source.image(0, 0).unwrap().to_f32()[0], 40.0 / 255.0);
        assert!(source.warnings().join(" ").contains(warning), "{:?}", source.warnings());
        assert_eq!(source.warnings().len(), usize::from(!warning.is_empty()), "{:?}", source.warnings());
    }
    fs::write(&path, "1\na b.png 0 0.6 -0.8\n").unwrap();
    let error = import::open(&path, &Default::default()).err().unwrap().to_string();
    assert!(error.contains("all lights are at or below the horizon"), "{error}");
}

#[test]
fn any_image_set_is_described_by_a_manifest() {
    let dir = tempfile::tempdir().unwrap();
    let grey = |v: usize, l: usize| 20 * (v as u8 + 1) + 3 * l as u8;
    for v in 0..2 {
        let folder = dir.path().join(format!("shots/v{}", v + 1));
        fs::create_dir_all(&folder).unwrap();
        for l in 0..3 {
            let picture = image::RgbImage::from_pixel(2, 2, image::Rgb([grey(v, l); 3]));
            picture.save(folder.join(format!("7_l{}.png", l + 1))).unwrap();
            let named = format!("t{}_{}.0-{}.png", 10 * l, 90 * l, v * 5);
            picture.save(dir.path().join(named)).unwrap();
        }
    }
    let path = dir.path().join("set.toml");
    let indexed = "loden_images = 1\nfiles = \"shots/v{view}/{any}_l{light}.png\"\nviews = [[0, 0], [30, 90]]\n\
                   lights = [[0, 0], [30, 0], [60, 180]]\ncount_from = 1\n";
    fs::write(&path, indexed).unwrap();
    let source = open(&path);
    assert_eq!((source.meta().views.len(), source.meta().lights.len()), (2, 3));
    assert!(source.missing().is_empty());
    assert_eq!(source.image(1, 2).unwrap().to_f32()[0], f32::from(grey(1, 2)) / 255.0);
    // exposures and encoding: linear light divided by the number of the light
    fs::write(&path, format!("{indexed}exposure = [1, 2, 4]\nencoding = \"gamma2\"\ncosine = \"excluded\"\n")).unwrap();
    let scaled = open(&path);
    assert_eq!((scaled.meta().encoding, scaled.meta().cosine), (Encoding::Linear, Cosine::Excluded));
    let expected = (f32::from(grey(0, 2)) / 255.0).powi(2) / 4.0;
    assert!((scaled.image(0, 2).unwrap().to_f32()[0] - expected).abs() < 1e-6);
    fs::write(&path, "loden_images = 1\nfiles = \"t{theta_l}_{phi_l}-{any}.png\"\n").unwrap();
    let error = import::open(&path, &Default::default()).err().unwrap().to_string();
    assert!(error.contains("the same directions as"), "{error}");
    fs::write(&path, "loden_images = 1\nfiles = \"t{theta_l}_{phi_l}-5.png\"\n").unwrap();
    let angles = open(&path);
    assert_eq!(angles.meta().lights.degrees(), [[0.0, 0.0], [10.0, 90.0], [20.0, 180.0]]);
    for (text, expected) in [
        ("files = \"x{light.png\"", "files: a { without a matching }"),
        ("files = \"x{lamp}.png\"", "{lamp} is not one of"),
        ("files = \"{view}{light}.png\"", "nothing separates"),
        ("files = \"q{light}.png\"", "found no file that matches"),
        ("files = \"shots/v{view}/{any}_l{light}.png\"", "but there are 1 directions"),
        ("files = \"shots/v1/{any}_l{light}.png\"\nviews = \"bonn81\"\nlights = \"bonn81\"", "has no {view}"),
        ("files = \"t{theta_l}_{phi_l}-5.png\"\nexposure = [1, 2]", "exposure: 2 numbers for 3 lights"),
        ("files = \"t{theta_l}_{phi_l}-5.png\"\nexposure = 0", "exposure: found 0, expected a positive number"),
    ] {
        fs::write(&path, format!("loden_images = 1\n{text}\n")).unwrap();
        let error = import::open(&path, &Default::default()).err().unwrap().to_string();
        assert!(error.contains("set.toml: ") && error.contains(expected), "{text}: {error}");
    }
}

/// A little-endian TIFF of one strip, every texel the same 16-bit grey.
fn grey_tiff(width: u16, height: u16, level: u16) -> Vec<u8> {
    let texels = level.to_le_bytes().repeat(usize::from(width) * usize::from(height));
    let directory = 8 + texels.len() as u32;
    // width, height, bits, no compression, black is zero, offset of the strip, rows in it, its bytes
    let tags = [
        (256, u32::from(width)),
        (257, u32::from(height)),
        (258, 16),
        (259, 1),
        (262, 1),
        (273, 8),
        (278, u32::from(height)),
        (279, texels.len() as u32),
    ];
    let mut bytes = [&b"II*\0"[..], &directory.to_le_bytes(), &texels].concat();
    bytes.extend((tags.len() as u16).to_le_bytes());
    for (tag, value) in tags {
        // type 4: LONG
        bytes.extend([u16::to_le_bytes(tag), u16::to_le_bytes(4)].concat());
        bytes.extend([1u32.to_le_bytes(), value.to_le_bytes()].concat());
    }
    bytes.extend(0u32.to_le_bytes());
    bytes
}

#[test]
fn pictures_of_more_than_eight_bits_are_floats() {
    let dir = tempfile::tempdir().unwrap();
    let name = |l: usize, ending: &str| format!("tl0{l}0 pl000 tv000 pv000.{ending}");
    for (ending, encoding) in
        [("hdr", Encoding::Linear), ("exr", Encoding::Linear), ("png", Encoding::Srgb), ("tif", Encoding::Srgb)]
    {
        let folder = dir.path().join(ending);
        fs::create_dir(&folder).unwrap();
        for l in 0..2 {
            let path = folder.join(name(l, ending));
            let value = 0.25 * (l + 1) as f32;
            match ending {
                "hdr" => {
                    // (128, 128, 128, e) is 2^(e - 129)
                    let pixel = [128, 128, 128, 127 + l as u8];
                    let bytes = [&b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 3\n"[..], &pixel.repeat(6)].concat();
                    fs::write(path, bytes).unwrap();
                }
                "exr" => Picture { width: 3, height: 2, rgb: vec![Vec3::splat(value); 6] }.write(&path).unwrap(),
                "tif" => fs::write(path, grey_tiff(3, 2, (value * 65535.0) as u16)).unwrap(),
                _ => {
                    let number = (value * 65535.0) as u16;
                    image::ImageBuffer::<image::Rgb<u16>, _>::from_pixel(3, 2, image::Rgb([number; 3]))
                        .save(path)
                        .unwrap();
                }
            }
        }
        let source = open(&folder);
        assert_eq!((source.meta().encoding, source.meta().sample_type), (encoding, SampleType::F32), "{ending}");
        assert!((source.image(0, 1).unwrap().to_f32()[0] - 0.5).abs() < 1e-4, "{ending}");
    }
}

#[test]
fn angles_are_turned_into_degrees_without_noise() {
    let source = {
        let mut file = Btf::new("!FMF06FC", 1);
        file.size(false);
        file.u32(0);
        file.0.push(2);
        file.u32(0);
        file.u32(18);
        file.u32(12);
        file.open()
    };
    let degrees = source.meta().views.degrees()[1];
    assert_eq!(degrees, [(0.5f64.to_degrees() * 1e4).round() / 1e4, (180.0 / PI * 1e4).round() / 1e4]);
}
