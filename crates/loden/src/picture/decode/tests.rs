use super::*;

/// A tag: its number, its type and its numbers.
type Tag<'a> = (u16, u16, &'a [u64]);

const SHORT: u16 = 3;
const LONG: u16 = 4;

/// A TIFF file of one strip, whose place is added to the tags.
fn tiff(tags: &[Tag], pixels: &[u8]) -> Vec<u8> {
    tiff_of(tags, &[pixels], 273, false, false)
}

/// A TIFF file of strips or tiles, by the tag of their places.
fn tiff_of(tags: &[Tag], chunks: &[&[u8]], places: u16, is_big_endian: bool, is_big: bool) -> Vec<u8> {
    let word = if is_big { 8 } else { 4 };
    let number = |value: u64, size: usize| {
        let bytes = value.to_be_bytes()[8 - size..].to_vec();
        if is_big_endian { bytes } else { bytes.into_iter().rev().collect() }
    };
    let mut bytes = if is_big_endian { b"MM".to_vec() } else { b"II".to_vec() };
    bytes.extend(number(if is_big { 43 } else { 42 }, 2));
    if is_big {
        bytes.extend([number(8, 2), number(0, 2)].concat());
    }
    let first = bytes.len();
    bytes.extend(vec![0; word]);
    let mut offsets = Vec::new();
    for chunk in chunks {
        offsets.push(bytes.len() as u64);
        bytes.extend_from_slice(chunk);
    }
    let lengths: Vec<u64> = chunks.iter().map(|chunk| chunk.len() as u64).collect();
    let lengths_tag = if places == 273 { 279 } else { 325 };
    let mut all: Vec<Tag> = tags.to_vec();
    all.extend([(places, LONG, &offsets[..]), (lengths_tag, LONG, &lengths[..])]);
    all.sort_by_key(|tag| tag.0);
    let mut directory = number(all.len() as u64, if is_big { 8 } else { 2 });
    for (tag, kind, values) in all {
        let size = match kind {
            SHORT => 2,
            LONG => 4,
            7 => 1,
            // rationals as one number of eight bytes
            _ => 8,
        };
        let mut content: Vec<u8> = values.iter().flat_map(|&value| number(value, size)).collect();
        if content.len() > word {
            let at = bytes.len() as u64;
            bytes.append(&mut content);
            content = number(at, word);
        }
        content.resize(word, 0);
        let head = [number(tag.into(), 2), number(kind.into(), 2), number(values.len() as u64, word)];
        directory.extend([head.concat(), content].concat());
    }
    directory.extend(vec![0; word]);
    let place = number(bytes.len() as u64, word);
    bytes[first..first + word].copy_from_slice(&place);
    bytes.extend(directory);
    bytes
}

fn read(bytes: &[u8]) -> Decoded {
    decode(bytes, Reading { strict: true, bonn: false }).unwrap()
}

fn error(bytes: &[u8]) -> String {
    decode(bytes, Reading::default()).unwrap_err().to_string()
}

/// Tags of a picture of 2 x 1 pixels.
fn tags<'a>(bits: &'a [u64], photometric: &'a [u64], channels: &'a [u64], others: &[Tag<'a>]) -> Vec<Tag<'a>> {
    let size = [(256, SHORT, &[2][..]), (257, SHORT, &[1][..])];
    let kind = [(258, SHORT, bits), (262, SHORT, photometric), (277, SHORT, channels)];
    [&size[..], &kind, others].concat()
}

#[test]
fn integers_of_all_sizes_are_read() {
    let sixteen =
        tiff(&tags(&[16, 16, 16], &[2], &[3], &[]), &[1u16, 2, 3, 4, 5, 60_000].map(u16::to_le_bytes).concat());
    assert_eq!(read(&sixteen).numbers, Numbers::U16(vec![1, 2, 3, 4, 5, 60_000]));
    let values = [0u32, u32::MAX, 0x5000_0000, 0x8000_0000, 0, 0].map(u32::to_le_bytes).concat();
    let found = read(&tiff(&tags(&[32, 32, 32], &[2], &[3], &[]), &values));
    assert_eq!(found.numbers, Numbers::F32(vec![0.0, 1.0, 0.3125, 0.5, 0.0, 0.0]));
    assert_eq!(found.encoding, Encoding::Srgb);
    let sixty_four = tiff(&tags(&[64], &[1], &[1], &[]), &[0, 1u64 << 63].map(u64::to_le_bytes).concat());
    assert_eq!(read(&sixty_four).numbers, Numbers::F32(vec![0.0, 0.0, 0.0, 0.5, 0.5, 0.5]));
    // bits are packed from the most significant one on
    let twelve = tiff(&tags(&[12], &[1], &[1], &[]), &[0xff, 0xf0, 0x01]);
    assert_eq!(read(&twelve).numbers, Numbers::U16(vec![65_535, 65_535, 65_535, 16, 16, 16]));
    let four = tiff(&tags(&[4], &[0], &[1], &[]), &[0xf3]);
    assert_eq!(read(&four).numbers, Numbers::U8(vec![0, 0, 0, 204, 204, 204]));
    for (fill_order, expected) in [(1u64, [0u8, 255]), (2, [255, 0])] {
        let one = tiff(&tags(&[1], &[1], &[1], &[(266, SHORT, &[fill_order])]), &[0b0100_0001]);
        assert_eq!(read(&one).numbers, Numbers::U8(expected.map(|v| [v; 3]).concat()), "{fill_order}");
    }
}

#[test]
fn floating_point_numbers_are_linear() {
    let values = [0.25f32, -3.5];
    let expected = Numbers::F32(vec![0.25, 0.25, 0.25, -3.5, -3.5, -3.5]);
    for (bits, bytes) in [
        (16u64, values.map(|v| half::f16::from_f32(v).to_le_bytes()).concat()),
        (24, [0x3d_0000u32, 0xc0_c000].map(|v| [v as u8, (v >> 8) as u8, (v >> 16) as u8]).concat()),
        (32, values.map(f32::to_le_bytes).concat()),
        (64, values.map(|v| f64::from(v).to_le_bytes()).concat()),
    ] {
        let found = read(&tiff(&tags(&[bits], &[1], &[1], &[(339, SHORT, &[3])]), &bytes));
        assert_eq!((&found.numbers, found.encoding), (&expected, Encoding::Linear), "{bits}");
    }
}

#[test]
fn predictors_are_undone() {
    let differences = [100u16, 1000, 5, 1, 65_436, 0].map(u16::to_le_bytes).concat();
    let found = read(&tiff(&tags(&[16; 3], &[2], &[3], &[(317, SHORT, &[2])]), &differences));
    assert_eq!(found.numbers, Numbers::U16(vec![100, 1000, 5, 101, 900, 5]));
    // bytes of equal significance together, then differences
    let values = [1.5f32, -0.125].map(f32::to_be_bytes);
    let mut bytes: Vec<u8> = (0..4).flat_map(|k| values.map(|v| v[k])).collect();
    (1..8).rev().for_each(|k| bytes[k] = bytes[k].wrapping_sub(bytes[k - 1]));
    let found = read(&tiff(&tags(&[32], &[1], &[1], &[(317, SHORT, &[3]), (339, SHORT, &[3])]), &bytes));
    assert_eq!(found.numbers, Numbers::F32(vec![1.5, 1.5, 1.5, -0.125, -0.125, -0.125]));
}

#[test]
fn tiles_planes_and_big_files_are_read() {
    // 3 x 2 pixels in tiles of 2 x 2, in three planes
    let pixel = |x: usize, y: usize, channel: usize| (x + 10 * y + 100 * channel.min(1) + 50 * (channel / 2)) as u8;
    let tile = |left: usize, channel: usize| -> Vec<u8> {
        (0..4).map(|k| pixel((left + k % 2).min(9), k / 2, channel)).collect()
    };
    let tiles: Vec<Vec<u8>> = (0..3).flat_map(|channel| [tile(0, channel), tile(2, channel)]).collect();
    let chunks: Vec<&[u8]> = tiles.iter().map(Vec::as_slice).collect();
    let all: [Tag; 8] = [
        (256, SHORT, &[3]),
        (257, SHORT, &[2]),
        (258, SHORT, &[8, 8, 8]),
        (262, SHORT, &[2]),
        (277, SHORT, &[3]),
        (284, SHORT, &[2]),
        (322, SHORT, &[2]),
        (323, SHORT, &[2]),
    ];
    let expected: Vec<u8> = (0..6).flat_map(|k| [0, 1, 2].map(|channel| pixel(k % 3, k / 3, channel))).collect();
    for (is_big_endian, is_big) in [(false, false), (true, false), (false, true), (true, true)] {
        let found = read(&tiff_of(&all, &chunks, 324, is_big_endian, is_big));
        assert_eq!(found.numbers, Numbers::U8(expected.clone()), "{is_big_endian} {is_big}");
    }
}

#[test]
fn compressions_are_unpacked() {
    let plain: Vec<u8> = (0..6).collect();
    let deflated = {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), Default::default());
        std::io::Write::write_all(&mut encoder, &plain).unwrap();
        encoder.finish().unwrap()
    };
    let lzw = weezl::encode::Encoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8).encode(&plain).unwrap();
    let zstd = zstd::encode_all(&plain[..], 1).unwrap();
    for (compression, bytes) in [
        (1u64, plain.clone()),
        (5, lzw),
        (8, deflated.clone()),
        (32_946, deflated),
        (50_000, zstd),
        (32_773, vec![2, 0, 1, 2, 2, 3, 4, 5]),
    ] {
        let found = read(&tiff(&tags(&[8; 3], &[2], &[3], &[(259, SHORT, &[compression])]), &bytes));
        assert_eq!(found.numbers, Numbers::U8(plain.clone()), "{compression}");
    }
    let runs = read(&tiff(&tags(&[8; 3], &[2], &[3], &[(259, SHORT, &[32_773])]), &[0xfb, 7]));
    assert_eq!(runs.numbers, Numbers::U8(vec![7; 6]));
}

#[test]
fn colours_of_all_kinds_are_converted() {
    let mut map = vec![0u64; 768];
    (map[7], map[256 + 7], map[512 + 7], map[1]) = (65_535, 257, 514, 257);
    let palette = tiff(&tags(&[8], &[3], &[1], &[(320, SHORT, &map)]), &[7, 1]);
    assert_eq!(read(&palette).numbers, Numbers::U8(vec![255, 1, 2, 1, 0, 0]));
    map[7] = 1000;
    let palette = tiff(&tags(&[8], &[3], &[1], &[(320, SHORT, &map)]), &[7, 1]);
    assert_eq!(read(&palette).numbers, Numbers::U16(vec![1000, 257, 514, 257, 0, 0]));
    let cmyk = read(&tiff(&tags(&[8; 4], &[5], &[4], &[]), &[0, 255, 51, 0, 0, 0, 0, 102]));
    assert_eq!(cmyk.numbers, Numbers::U8(vec![255, 0, 204, 153, 153, 153]));
    assert!(cmyk.warnings[0].contains("CMYK"));
    // a block of 2 x 1 pixels: Y, Y, Cb, Cr of pure red and of the same colour, darker
    let ycbcr = read(&tiff(&tags(&[8; 3], &[6], &[3], &[(530, SHORT, &[2, 1])]), &[76, 26, 85, 255]));
    let Numbers::U8(found) = ycbcr.numbers else { panic!("bytes expected") };
    assert!(found.iter().zip([254u8, 0, 0, 204, 0, 0]).all(|(a, b)| a.abs_diff(b) <= 2), "{found:?}");
    let alpha = read(&tiff(&tags(&[8; 2], &[1], &[2], &[(338, SHORT, &[2])]), &[9, 255, 8, 255]));
    assert_eq!((alpha.numbers, alpha.warnings.len()), (Numbers::U8(vec![9, 9, 9, 8, 8, 8]), 0));
    let bands = read(&tiff(&tags(&[8; 5], &[1], &[5], &[]), &[9, 1, 2, 3, 4, 8, 1, 2, 3, 4]));
    assert!(bands.warnings[0].contains("the first 1 of 5 channels"), "{:?}", bands.warnings);
}

#[test]
fn jpeg_strips_are_decoded() {
    let mut jpeg = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut jpeg, 95);
    encoder.encode(&[60, 180, 90].repeat(64), 8, 8, jpeg_encoder::ColorType::Rgb).unwrap();
    // the tables apart, as most programs write them
    let frame = jpeg.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
    let tables: Vec<u64> = [&jpeg[..frame], &[0xff, 0xd9]].concat().iter().map(|&b| b.into()).collect();
    let strip = [&[0xff, 0xd8], &jpeg[frame..]].concat();
    let all: [Tag; 7] = [
        (256, SHORT, &[8]),
        (257, SHORT, &[8]),
        (258, SHORT, &[8, 8, 8]),
        (259, SHORT, &[7]),
        (262, SHORT, &[6]),
        (277, SHORT, &[3]),
        (347, 7, &tables),
    ];
    let Numbers::U8(found) = read(&tiff(&all, &strip)).numbers else { panic!("bytes expected") };
    assert!(found.chunks_exact(3).all(|c| c[0].abs_diff(60) < 4 && c[1].abs_diff(180) < 4 && c[2].abs_diff(90) < 4));
}

#[test]
fn tags_that_turn_or_colour_a_picture_are_applied() {
    let turned = read(&tiff(&tags(&[8], &[1], &[1], &[(274, SHORT, &[6])]), &[1, 2]));
    assert_eq!(([turned.width, turned.height], turned.numbers), ([1, 2], Numbers::U8(vec![1, 1, 1, 2, 2, 2])));
    let rational = |v: f64| -> u64 { ((v * 10_000.0) as u64) | 10_000 << 32 };
    let primaries = [0.68, 0.32, 0.265, 0.69, 0.15, 0.06].map(rational);
    let display_p3 = read(&tiff(&tags(&[8; 3], &[2], &[3], &[(319, 5, &primaries)]), &[1, 2, 3, 4, 5, 6]));
    assert!((display_p3.to_rec709.unwrap().x_axis.x - 1.2249).abs() < 2e-3);
}

#[test]
fn tiff_files_that_are_not_read_are_named() {
    for (bytes, fault) in [
        (tiff(&tags(&[16], &[1], &[1], &[(339, SHORT, &[2])]), &[0; 4]), "signed integers"),
        (tiff(&tags(&[64], &[1], &[1], &[(339, SHORT, &[6])]), &[0; 16]), "complex"),
        (tiff(&tags(&[8; 3], &[8], &[3], &[]), &[0; 6]), "L*a*b*"),
        (tiff(&tags(&[8; 3], &[32_803], &[3], &[]), &[0; 6]), "raw sensor data"),
        (tiff(&tags(&[8], &[1], &[1], &[(259, SHORT, &[34_887])]), &[0; 6]), "LERC"),
        (tiff(&tags(&[5, 6, 5], &[2], &[3], &[]), &[0; 6]), "number of bits"),
        (tiff(&tags(&[8; 3], &[2], &[3], &[]), &[0; 5]), "found 5 bytes, expected 6"),
        (tiff(&tags(&[8], &[2], &[1], &[]), &[0; 5]), "expected at least 3"),
        (b"II*\0\xff\xff\0\0".to_vec(), "directory"),
        (b"II+\0".to_vec(), "directory"),
    ] {
        let found = error(&bytes);
        assert!(found.contains(fault), "{found}");
    }
}

/// The content of an EXR file with these channels of 2 x 1 pixels.
fn exr(channels: &[(&str, [f32; 2])], chromaticities: Option<[f32; 8]>) -> Vec<u8> {
    use ::exr::prelude::*;
    let channel = |(name, values): &(&str, [f32; 2])| AnyChannel::new(*name, FlatSamples::F32(values.to_vec()));
    let channels = AnyChannels::sort(channels.iter().map(channel).collect());
    let layer = Layer::new((2, 1), LayerAttributes::default(), Encoding::UNCOMPRESSED, channels);
    let mut image = Image::from_layer(layer);
    image.attributes.chromaticities = chromaticities.map(|[rx, ry, gx, gy, bx, by, wx, wy]| {
        let (red, green) = (Vec2(rx, ry), Vec2(gx, gy));
        ::exr::meta::attribute::Chromaticities { red, green, blue: Vec2(bx, by), white: Vec2(wx, wy) }
    });
    let mut file = std::io::Cursor::new(Vec::new());
    image.write().to_buffered(&mut file).unwrap();
    file.into_inner()
}

#[test]
fn exr_files_with_other_channels_are_read() {
    let colours = Numbers::F32(vec![1.0, 3.0, 5.0, 2.0, 4.0, 6.0]);
    let grey = Numbers::F32(vec![1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
    let (r, g, b) = ([1.0, 2.0], [3.0, 4.0], [5.0, 6.0]);
    for (channels, expected, warning) in [
        (vec![("R", r), ("G", g), ("B", b)], &colours, ""),
        (vec![("R", r), ("G", g), ("B", b), ("A", r), ("Z", r)], &colours, ""),
        (vec![("beauty.R", r), ("beauty.G", g), ("beauty.B", b)], &colours, ""),
        (vec![("R", r), ("G", g), ("B", b), ("light.R", b), ("light.G", g), ("light.B", r)], &colours, "\"light\""),
        (vec![("Y", r)], &grey, ""),
        (vec![("Y", r), ("A", g)], &grey, ""),
        (vec![("depth", r)], &grey, "the only channel depth"),
    ] {
        let found = read(&exr(&channels, None));
        assert_eq!(&found.numbers, expected, "{channels:?}");
        assert!(found.warnings.join(" ").contains(warning) && found.warnings.is_empty() == warning.is_empty());
    }
    // luminance and differences of the colour (0.5, 0.25, 1)
    let y = 0.2126 * 0.5 + 0.7152 * 0.25 + 0.0722;
    let chroma = [("Y", [y; 2]), ("RY", [(0.5 - y) / y; 2]), ("BY", [(1.0 - y) / y; 2])];
    let Numbers::F32(found) = read(&exr(&chroma, None)).numbers else { panic!("floats expected") };
    assert!(found.iter().zip([0.5, 0.25, 1.0]).all(|(a, b)| (a - b).abs() < 1e-3), "{found:?}");
    assert!(error(&exr(&[("N", r), ("M", g)], None)).contains("found the channels M, N"));
}

#[test]
fn exr_primaries_are_converted() {
    let channels = [("R", [1.0, 0.0]), ("G", [0.0, 0.0]), ("B", [0.0, 1.0])];
    let rec_709 = [0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290];
    assert_eq!(read(&exr(&channels, Some(rec_709))).to_rec709, None);
    let rec_2020 = [0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290];
    let found = read(&exr(&channels, Some(rec_2020))).linear(None);
    assert!(found[0].abs_diff_eq(Vec3::new(1.6605, -0.1246, -0.0182), 1e-3), "{}", found[0]);
    let xyz = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0 / 3.0, 1.0 / 3.0];
    let (numbers, encoding) = read(&exr(&channels, Some(xyz))).resolved(None);
    let Numbers::F32(numbers) = numbers else { panic!("floats expected") };
    assert!((numbers[0] - 3.2405).abs() < 2e-3 && encoding == Encoding::Linear, "{numbers:?}");
    let line = [0.1, 0.1, 0.2, 0.2, 0.3, 0.3, 0.3, 0.3];
    assert!(error(&exr(&channels, Some(line))).contains("do not span"));
}

#[test]
fn panics_of_decoders_are_errors() {
    // a file that makes the decoder of another crate panic stands in for all of them
    let panicking = guarded("PNG", || -> Result<Decoded> { panic!("index out of bounds") });
    assert!(panicking.unwrap_err().contains("the PNG decoder failed"));
}
