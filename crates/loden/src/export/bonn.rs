//! Shared parts of Bonn's `.btf` formats: the header, and texels in linear light.

use crate::btf::{BtfMeta, Cosine, Texels};
use crate::color::Encoding;

/// Signature, measurement block (version 4) and directions, followed by the size.
pub(super) fn header(signature: &[u8], meta: &BtfMeta) -> Vec<u8> {
    let mut block = 4u32.to_le_bytes().to_vec();
    for text in ["unknown", "unknown", "unknown"] {
        let mut field = [0; 80];
        field[..text.len()].copy_from_slice(text.as_bytes());
        block.extend(field);
    }
    // the number of pixels per millimetre is unknown; the colour scale is 1
    block.extend([1.0f32; 4].iter().flat_map(|v| v.to_le_bytes()));
    block.extend(u32::from(meta.cosine == Cosine::Included).to_le_bytes());
    block.extend(0u32.to_le_bytes());
    block.extend(3u32.to_le_bytes());
    for name in [b'R', b'G', b'B'] {
        block.extend(1u32.to_le_bytes());
        block.push(name);
    }
    let mut bytes = signature.to_vec();
    bytes.extend((block.len() as u32 + 4).to_le_bytes());
    bytes.extend(block);
    let angles = |[theta, phi]: [f64; 2]| {
        // the format's azimuths are in -180..180 degrees
        let phi = if phi >= 180.0 { phi - 360.0 } else { phi };
        [theta, phi].map(|degrees| (degrees.to_radians() as f32).to_le_bytes()).concat()
    };
    bytes.extend((meta.views.len() as u32).to_le_bytes());
    for &view in meta.views.degrees() {
        bytes.extend(angles(view));
        bytes.extend((meta.lights.len() as u32).to_le_bytes());
        bytes.extend(meta.lights.degrees().iter().flat_map(|&light| angles(light)));
    }
    bytes.extend([meta.width as u32, meta.height as u32].iter().flat_map(|n| n.to_le_bytes()));
    bytes
}

/// Linear RGB of one image in the order of the file: the bottom row first.
pub(super) fn linear(texels: &Texels<'_>, meta: &BtfMeta) -> Vec<f32> {
    let decoded: Vec<f32> = match texels {
        Texels::U8(bytes) => {
            let table: Vec<f32> = (0..256).map(|i| meta.encoding.decode(i as f32 / 255.0)).collect();
            bytes.iter().map(|&v| table[usize::from(v)]).collect()
        }
        _ if meta.encoding == Encoding::Linear => texels.to_f32().into_owned(),
        _ => texels.to_f32().iter().map(|&v| meta.encoding.decode(v)).collect(),
    };
    decoded.chunks_exact(3 * meta.width).rev().flatten().copied().collect()
}
