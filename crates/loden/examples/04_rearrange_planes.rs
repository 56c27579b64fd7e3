//! Rearrange the planes of a compressed material without decoding it: the sample begins half its height further down.

use loden::Result;
use loden::btf::Rect;
use loden::codec;
use loden::codec::parts::{MemoryParts, Numbers, Parts, store};

fn shifted(parts: &dyn Parts) -> Result<MemoryParts> {
    let (meta, mut result) = (parts.meta(), MemoryParts::copy(parts)?);
    for (plane, spec) in parts.recipe().planes.iter().enumerate() {
        let mut rows = Vec::new();
        for view in 0..if spec.per_view() { meta.views.len() } else { 1 } {
            for y in (0..meta.height).map(|y| (y + meta.height / 2) % meta.height) {
                rows.push(parts.plane(plane, view, Rect { x: 0, y, width: meta.width, height: 1 })?);
            }
        }
        result.set_plane(plane, Numbers::concat(&rows).expect("rows of one plane are of one type"))?;
    }
    Ok(result)
}

fn main() -> Result<()> {
    // of any codec: planes of coefficients, cluster numbers or parameters are moved alike
    let material = codec::open(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/kmeans-u8.loden"))?;
    let path = std::env::temp_dir().join("loden-example-shifted.loden");
    store(&shifted(&**material.parts())?, &material.provenance()?, &path)?;

    let shifted = codec::open(&path)?;
    let meta = material.meta();
    let (mut before, mut after) = (vec![0.0; meta.image_len()], vec![0.0; meta.image_len()]);
    material.decode_image(0, 0, &mut before)?;
    shifted.decode_image(0, 0, &mut after)?;
    before.rotate_left(3 * meta.width * (meta.height / 2));
    assert_eq!(before, after);
    Ok(())
}
