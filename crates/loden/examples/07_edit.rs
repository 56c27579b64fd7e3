//! Recolour a material: the diffuse part of its rows turns green, highlights keep the colour of the light.

use std::sync::Arc;

use loden::codec::{self, Decoded, parts::store};
use loden::generate::{self, Edit, Rows, Selection};
use loden::{Error, Result};

fn main() -> Result<()> {
    let material = codec::open(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/kmeans-u8.loden"))?;
    let rows = Rows::new(material.parts().clone())?.ok_or_else(|| Error::parameter("material", "it has no rows"))?;
    let edit = Edit { recolor: Some("hue=120".parse()?), gloss: 0.8, ..Edit::default() };
    let parts = generate::edit(&rows, &Selection::All, &edit)?;

    // ready for display at once, and as a file
    let shown = Decoded::new(Arc::new(parts.clone()))?;
    store(&parts, &material.provenance()?, &std::env::temp_dir().join("loden-example-green.loden"))?;
    let mut image = vec![0.0; material.meta().image_len()];
    shown.decode(0, 0..1, &mut image)?;
    assert!(image.iter().all(|v| v.is_finite()));
    Ok(())
}
