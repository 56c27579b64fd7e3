use super::*;

fn ramp() -> Picture {
    let rgb = (0..35).map(|i| Vec3::new(i as f32 / 34.0, 0.5, 1.0 - i as f32 / 40.0)).collect();
    Picture { width: 7, height: 5, rgb }
}

fn largest_difference(a: &Picture, b: &Picture) -> f32 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    a.rgb.iter().zip(&b.rgb).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f32::max)
}

#[test]
fn exr_files_are_deterministic() {
    // Enough blocks of unequal cost for threads to finish them out of order.
    let (width, height) = (256, 1024);
    let value = |i: usize| if (i / (32 * width)).is_multiple_of(2) { 0.5 } else { (i as f32 * 0.618).fract() };
    let picture = Picture { width, height, rgb: (0..width * height).map(|i| Vec3::splat(value(i))).collect() };
    let first = picture.to_exr(FloatType::F32).unwrap();
    assert!((0..24).all(|_| picture.to_exr(FloatType::F32).unwrap() == first));
}

#[test]
fn every_format_round_trips() {
    let dir = tempfile::tempdir().unwrap();
    let picture = ramp();
    let (png, exr, half) = (dir.path().join("a.png"), dir.path().join("a.exr"), dir.path().join("h.exr"));
    picture.write(&png).unwrap();
    picture.write(&exr).unwrap();
    picture.write_exr(&half, FloatType::F16).unwrap();
    assert_eq!(Picture::read(&exr, &mut Vec::new()).unwrap(), picture);
    assert!(largest_difference(&Picture::read(&half, &mut Vec::new()).unwrap(), &picture) <= 1.0 / 2048.0);
    // Half an 8-bit step, at the steepest part of the sRGB curve.
    assert!(largest_difference(&Picture::read(&png, &mut Vec::new()).unwrap(), &picture) <= 0.5 / 255.0 * 2.4);
}

#[test]
fn sixteen_bit_png_keeps_its_precision() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.png");
    let values: Vec<u16> = (0..48).map(|i| i * 1300).collect();
    image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(4, 4, values.clone()).unwrap().save(&path).unwrap();
    let read = Picture::read(&path, &mut Vec::new()).unwrap();
    for (found, stored) in read.rgb.iter().flat_map(|c| c.to_array()).zip(values) {
        assert_eq!(found, Encoding::Srgb.decode(f32::from(stored) / 65_535.0));
    }
}

#[test]
fn jpeg_round_trips() {
    let mut picture = Picture::filled(40, 24, Vec3::new(0.1, 0.3, 0.6));
    picture.rgb[..40 * 12].fill(Vec3::new(0.5, 0.2, 0.05));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.jpg");
    fs::write(&path, picture.to_jpeg(90).unwrap()).unwrap();
    let found = Picture::read(&path, &mut Vec::new()).unwrap();
    assert_eq!((found.width, found.height), (40, 24));
    let mean = |p: &Picture| p.rgb.iter().sum::<Vec3>() / p.rgb.len() as f32;
    assert!(mean(&found).abs_diff_eq(mean(&picture), 0.01), "{} {}", mean(&found), mean(&picture));
    assert_eq!(Picture::filled(70_000, 1, Vec3::ONE).to_jpeg(90), None);
}

#[test]
fn hdr_and_jpeg_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.hdr");
    let pixels = [128u8, 64, 32, 131].repeat(12);
    fs::write(&path, [&b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 3 +X 4\n"[..], &pixels].concat()).unwrap();
    assert_eq!(Picture::read(&path, &mut Vec::new()).unwrap(), Picture::filled(4, 3, Vec3::new(4.0, 2.0, 1.0)));
    let path = dir.path().join("a.jpg");
    let encoder = jpeg_encoder::Encoder::new_file(&path, 100).unwrap();
    encoder.encode(&[188; 3 * 16 * 8], 16, 8, jpeg_encoder::ColorType::Rgb).unwrap();
    let grey = Picture::filled(16, 8, Vec3::splat(Encoding::Srgb.decode(188.0 / 255.0)));
    assert!(largest_difference(&Picture::read(&path, &mut Vec::new()).unwrap(), &grey) < 0.01);
}

#[test]
fn negative_light_becomes_zero_with_a_warning() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.exr");
    let mut picture = ramp();
    picture.rgb[9].y = -6e-8;
    picture.write(&path).unwrap();
    let mut warnings = Vec::new();
    let read = Picture::read_light(&path, &mut warnings).unwrap();
    assert!(read.rgb[9].y == 0.0 && read.rgb[8] == picture.rgb[8]);
    assert!(warnings[0].contains("a.exr: 1 negative value becomes 0; the lowest is -6e-8"), "{warnings:?}");
}

#[test]
fn images_that_are_not_finite_are_not_written() {
    let dir = tempfile::tempdir().unwrap();
    let mut picture = ramp();
    picture.rgb[9].y = f32::NAN;
    for name in ["a.png", "a.exr"] {
        let path = dir.path().join(name);
        let error = picture.write(&path).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("pixel (2, 1)"), "{error}");
        assert!(!path.exists());
    }
    let bright = Picture::filled(1, 1, Vec3::splat(1e6));
    assert!(bright.write_exr(dir.path().join("b.exr"), FloatType::F16).is_err());
    assert!(matches!(ramp().write(dir.path().join("a.gif")), Err(Error::Unsupported { .. })));
}

#[test]
fn errors_of_damaged_files_name_the_file() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["a.png", "a.exr"] {
        let path = dir.path().join(name);
        ramp().write(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        for length in [0, 5, 20, bytes.len() / 2] {
            fs::write(&path, &bytes[..length]).unwrap();
            let error = Picture::read(&path, &mut Vec::new()).unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        }
    }
}

#[test]
fn a_huge_header_is_refused_before_allocation() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.hdr");
    fs::write(&path, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\n").unwrap();
    assert!(matches!(Picture::read(&path, &mut Vec::new()), Err(Error::Limit { found: 3_600_000_000, .. })));
}

#[test]
fn files_say_what_made_them_and_in_which_colours() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let command = "loden render --scene 'f\u{fc}r.toml'";
    ramp().write_noted(at("a.png"), Some(command)).unwrap();
    ramp().write_noted(at("a.exr"), Some("loden render")).unwrap();
    let png = fs::read(at("a.png")).unwrap();
    let holds = |bytes: &[u8], part: &[u8]| bytes.windows(part.len()).any(|window| window == part);
    assert!(holds(&png, b"sRGB\0") && holds(&png, format!("Software\0{PROGRAM}").as_bytes()));
    assert!(holds(&png, format!("Command\0\0\0\0\0{command}").as_bytes()));
    // every chunk has the right length and checksum
    let mut rest = &png[8..];
    while !rest.is_empty() {
        let length = u32::from_be_bytes(rest[..4].try_into().unwrap()) as usize;
        let sum = u32::from_be_bytes(rest[8 + length..12 + length].try_into().unwrap());
        assert_eq!(sum, crc32fast::hash(&rest[4..8 + length]));
        rest = &rest[12 + length..];
    }
    let meta = exr::meta::MetaData::read_from_file(at("a.exr"), false).unwrap();
    let header = &meta.headers[0];
    assert_eq!(header.own_attributes.software_name.as_ref().unwrap().to_string(), PROGRAM);
    assert_eq!(header.own_attributes.comments.as_ref().unwrap().to_string(), "loden render");
    assert_eq!(header.shared_attributes.chromaticities.unwrap().red, exr::math::Vec2(0.64, 0.33));
}
