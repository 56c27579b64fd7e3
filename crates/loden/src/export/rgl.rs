//! `rgl`: `.bsdf` files in the layout of the EPFL goniometer, read by Mitsuba 3 and pbrt.
//!
//! # Format
//! As read by the importer of that name: a tensor file with `version`, `description`, `phi_i`, `theta_i`, `ndf`, `sigma`,
//! `vndf`, `luminance`, `rgb`, `jacobian` and `valid`. The values contain the cosine of the outgoing direction.

use std::path::Path;

use super::{BrdfExporter, check_finite};
use crate::Result;
use crate::import::tensor::MAGIC;
use crate::material::{BrdfSample, Material, RglData};
use crate::params::Values;

pub(super) struct Rgl;

impl BrdfExporter for Rgl {
    fn name(&self) -> &'static str {
        "rgl"
    }

    fn doc(&self) -> &'static str {
        "`NAME.bsdf`: the adaptive table of the EPFL goniometer, RGB; Mitsuba 3 and pbrt read it."
    }

    fn ending(&self) -> &'static str {
        "bsdf"
    }

    fn losses(&self, _material: &dyn Material) -> Vec<&'static str> {
        vec!["detail finer than the nodes of the adaptive table", "the spectrum, if there is one"]
    }

    fn write(&self, material: &dyn Material, _samples: &[BrdfSample], path: &Path, _options: &Values) -> Result<()> {
        let data = RglData::tabulate(material);
        let tables = [&data.sigma.1, &data.ndf.1, &data.vndf.1, &data.luminance.1, &data.rgb];
        check_finite(tables.into_iter().flatten().copied())?;
        let [phis, thetas] = [data.phi_i.len(), data.theta_i.len()];
        let [rows, columns] = data.luminance.0;
        let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let table = |(size, values): &([usize; 2], Vec<f32>)| (size.to_vec(), floats(values));
        let nested = |(size, values): &([usize; 2], Vec<f32>)| (vec![phis, thetas, size[0], size[1]], floats(values));
        let description = b"written by loden".to_vec();
        let with = |name, number, (shape, bytes): (Vec<usize>, Vec<u8>)| Field { name, number, shape, bytes };
        let fields = [
            with("version", 5, (vec![2], [1u32, 0].iter().flat_map(|v| v.to_le_bytes()).collect())),
            with("description", 1, (vec![description.len()], description)),
            with("phi_i", 10, (vec![phis], floats(&data.phi_i))),
            with("theta_i", 10, (vec![thetas], floats(&data.theta_i))),
            with("sigma", 10, table(&data.sigma)),
            with("ndf", 10, table(&data.ndf)),
            with("vndf", 10, nested(&data.vndf)),
            with("luminance", 10, nested(&data.luminance)),
            with("rgb", 10, (vec![phis, thetas, 3, rows, columns], floats(&data.rgb))),
            with("jacobian", 1, (vec![1], vec![1])),
            with("valid", 1, (vec![rows, columns], vec![1; rows * columns])),
        ];
        crate::output::write_file(path, |file| file.write_all(&tensor_file(&fields)))
    }
}

struct Field {
    name: &'static str,
    /// The code of the number type in the file.
    number: u8,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

fn tensor_file(fields: &[Field]) -> Vec<u8> {
    let head: usize = fields.iter().map(|f| 2 + f.name.len() + 2 + 1 + 8 + 8 * f.shape.len()).sum();
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    bytes.extend((fields.len() as u32).to_le_bytes());
    let mut at = (bytes.len() + head).next_multiple_of(8);
    for field in fields {
        bytes.extend((field.name.len() as u16).to_le_bytes());
        bytes.extend(field.name.as_bytes());
        bytes.extend((field.shape.len() as u16).to_le_bytes());
        bytes.push(field.number);
        bytes.extend((at as u64).to_le_bytes());
        field.shape.iter().for_each(|&n| bytes.extend((n as u64).to_le_bytes()));
        at = (at + field.bytes.len()).next_multiple_of(8);
    }
    for field in fields {
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes.extend(&field.bytes);
    }
    bytes
}
