//! Open a compressed material and evaluate it.

use loden::codec;
use loden::direction::{Scheme, from_angles};

fn main() -> loden::Result<()> {
    let file =
        std::env::args().nth(1).unwrap_or(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/pvmf-f16.loden").into());
    let compressed = codec::open(file)?;
    let meta = compressed.meta();
    println!("{}: {} x {} texels, {} images", compressed.method(), meta.width, meta.height, meta.pairs());

    // between texels and between measured directions, radians
    let material = compressed.material(Scheme::Triangles)?;
    let (light, view) = (from_angles(0.5, 1.0), from_angles(0.3, 4.0));
    println!("{}", material.apparent([0.25, 0.75].into(), light, view)); // pi L / E, linear RGB
    Ok(())
}
