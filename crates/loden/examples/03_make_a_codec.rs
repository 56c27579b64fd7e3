//! Make a codec of your own: a brightness for each texel times a colour for each pair of directions.

use loden::btf::{BtfSource, SampleType};
use loden::codec::container::SourceInfo;
use loden::codec::parts::{Axis, Curve, Expr, MemoryParts, Numbers, PlaneSpec, Provenance, Recipe, TableSpec, store};
use loden::glam::Vec3;
use loden::{Result, codec, metric, progress::Silent};

fn tinted(source: &dyn BtfSource) -> Result<MemoryParts> {
    let meta = source.meta();
    let (mut brightness, mut colour) = (vec![0.0; meta.texels()], Vec::new());
    for view in 0..meta.views.len() {
        for image in source.view(view)?.to_f32().chunks_exact(meta.image_len()) {
            let texels = image.chunks_exact(3).map(|rgb| Vec3::from_slice(rgb).map(|v| meta.encoding.decode(v)));
            brightness.iter_mut().zip(texels.clone()).for_each(|(sum, texel)| *sum += texel.element_sum());
            colour.extend((texels.sum::<Vec3>() / meta.texels() as f32).to_array());
        }
    }
    let mean = brightness.iter().sum::<f32>() / meta.texels() as f32;
    brightness.iter_mut().for_each(|sum| *sum /= mean);

    // linear light = brightness x colour, a dot product of one component
    let axes = [Axis::View, Axis::Light, Axis::Component(1), Axis::Channel];
    let planes = vec![PlaneSpec::numbers("brightness", 1, SampleType::F32)];
    let tables = vec![TableSpec::new("colour", &axes, SampleType::F32)];
    let recipe = Recipe { planes, tables, value: Expr::dot(0, 0), curve: Curve::Linear };
    let [planes, tables] = [brightness, colour].map(|numbers| vec![Numbers::F32(numbers.into())]);
    MemoryParts::new(meta.clone(), recipe, planes, tables)
}

fn main() -> Result<()> {
    let source = codec::open(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/pvmf-f16.loden"))?;
    let path = std::env::temp_dir().join("loden-example-tinted.loden");
    store(&tinted(&*source)?, &Provenance::unknown(SourceInfo::new(&*source)?), &path)?;
    let opened = codec::open(&path)?; // by the recipe in the file, anywhere
    println!("{} bytes, {:?}", opened.bytes(), metric::compare(&*source, &*opened, &Silent)?);
    Ok(())
}
