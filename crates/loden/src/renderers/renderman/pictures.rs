//! A material's shader with its textures.

use std::fs;
use std::path::Path;

use super::Textures;
use crate::codec::CompressedBtf;
use crate::codec::parts::carrier::{self, Carried, Form};
use crate::output::failed;
use crate::picture::four_channels::{Samples, write};
use crate::renderers::shader::{Bank, Format, Shader};
use crate::{Error, Result};

/// Addresses are below this: the language counts in single precision.
const MOST_TEXELS: usize = 1 << 24;

/// Memory for textures that a scene asks for, at least, in kilobytes.
const LEAST_MEMORY: usize = 32_768;

/// A shader that was written.
pub(super) struct Written {
    /// Its name.
    shader: String,
    /// Values of its three parameters that name textures.
    files: [String; 3],
    /// Memory of its textures in kilobytes.
    memory: usize,
    /// What the textures are.
    textures: Textures,
}

impl Written {
    /// Writes shader and textures into a folder.
    pub fn write(
        name: &str,
        textures: Textures,
        shader: &Shader,
        material: &CompressedBtf,
        folder: &Path,
    ) -> Result<Self> {
        let (path, meta) = (material.path(), material.meta());
        shader.banks.iter().try_for_each(|bank| check(path, bank))?;
        let in_folder = |file: &str| folder.join(file);
        let tail = include_str!("tail.sl");
        let of_bank = |bank: &Bank| format!("{name}_{}.tif", bank.name);
        let carried = match textures {
            Textures::Tiff => None,
            Textures::Carrier => carrier::carried(material.parts().recipe(), meta),
        };
        let (files, text) = match &carried {
            None => {
                for bank in &shader.banks {
                    texture(bank, &in_folder(&of_bank(bank)))?;
                }
                let head = concat!(include_str!("head.sl"), include_str!("tiff.sl"));
                (shader.banks.each_ref().map(of_bank), shader.rsl(head, tail))
            }
            Some(carried) => {
                carrier::write(path, meta, &shader.numbers, carried, folder, name)?;
                let directions = of_bank(&shader.banks[2]);
                carry(&shader.banks[2], &in_folder(&directions))?;
                let numbers = match carried.form {
                    Form::Views { .. } => name.to_owned(),
                    Form::Index { .. } => format!("{name}_block.tif"),
                };
                ([numbers, format!("{name}_index.tif"), directions], shader.rsl(&head(carried, shader, material), tail))
            }
        };
        let bytes: usize = shader.banks.iter().map(|bank| bank.sides().iter().product::<usize>() * 16).sum();
        let memory = (bytes / 512).max(LEAST_MEMORY);
        let written = Self { shader: name.into(), files, memory, textures };
        let path = in_folder(&format!("{name}.sl"));
        fs::write(&path, written.filled(&text)).map_err(failed(&path))?;
        Ok(written)
    }

    /// A text with the names of the shader and its textures.
    pub fn filled(&self, text: &str) -> String {
        let [numbers, indices, directions] = &self.files;
        let kind = match self.textures {
            Textures::Tiff => "TIFF pictures of four channels, of floating-point numbers but for the indices",
            Textures::Carrier => {
                "TIFF pictures of four bytes a pixel, which are the bits of a number of single precision, described by `carrier.json`"
            }
        };
        text.replace("{SHADER}", &self.shader)
            .replace("{NUMBERS}", numbers)
            .replace("{INDICES}", indices)
            .replace("{DIRECTIONS}", directions)
            .replace("{MEMORY}", &self.memory.to_string())
            .replace("{TEXTURES}", kind)
    }
}

/// Checks that the addresses of a bank are exact numbers.
fn check(path: &Path, bank: &Bank) -> Result<()> {
    let [columns, rows] = bank.sides();
    if columns * rows <= MOST_TEXELS {
        return Ok(());
    }
    let found = columns * rows;
    let problem = format!(
        "its {} need {found} texels; the shading language counts to {MOST_TEXELS} in single precision",
        bank.name
    );
    Err(Error::unsupported(path, problem))
}

/// Writes the numbers of a bank as a picture of four channels.
fn texture(bank: &Bank, path: &Path) -> Result<()> {
    let sides = bank.sides();
    let texels = (0..sides[0] * sides[1]).map(|address| bank.texel(address));
    if bank.format == Format::Byte {
        let bytes: Vec<u8> = texels.flatten().map(|number| (number * 255.0).round() as u8).collect();
        return write(path, sides, Samples::Bytes(&bytes));
    }
    let singles: Vec<f32> = texels.flatten().collect();
    write(path, sides, Samples::Singles(&singles))
}

/// Writes the numbers of a bank by their bits, four pixels for each texel.
fn carry(bank: &Bank, path: &Path) -> Result<()> {
    let [columns, rows] = bank.sides();
    let texels = (0..columns * rows).flat_map(|address| bank.texel(address));
    let bytes: Vec<u8> = texels.flat_map(carrier::pixel).collect();
    write(path, [4 * columns, rows], Samples::Bytes(&bytes))
}

/// The functions that read the carrier.
fn head(carried: &Carried, shader: &Shader, material: &CompressedBtf) -> String {
    let (meta, sides, places) = (material.meta(), carried.form.sides(material.meta()), &shader.places);
    // an address that no number has
    let nowhere = MOST_TEXELS;
    let mut numbers = vec![
        ("PLANE", places.planes[carried.plane].unwrap_or(nowhere)),
        ("TABLE", places.tables[carried.table].unwrap_or(nowhere)),
        ("MEAN", carried.mean.and_then(|mean| places.tables[mean]).unwrap_or(nowhere)),
        ("VIEWS", meta.views.len()),
        ("LIGHTS", meta.lights.len()),
        ("PAIRS", meta.views.len() * meta.lights.len()),
        ("TEXELS", meta.texels()),
        ("TEXELS_WIDE", meta.width),
        ("TEXELS_HIGH", meta.height),
        ("TEXEL_COLUMNS", sides.texels[0]),
        ("TEXEL_ROWS", sides.texels[1]),
        ("TABLE_COLUMNS", sides.table[0]),
        ("TABLE_ROWS", sides.table[1]),
        ("ACROSS", sides.across),
    ];
    let reading = match carried.form {
        Form::Views { components, mean } => {
            let rows = components + usize::from(mean);
            numbers.extend([("COMPONENTS", components), ("ROWS_OF_VIEW", rows), ("GROUPS", components.div_ceil(4))]);
            include_str!("views.sl")
        }
        Form::Index { rows } => {
            numbers.push(("BYTES_OF_INDEX", if rows <= 256 { 1 } else { 2 }));
            include_str!("index.sl")
        }
    };
    let text = concat!(include_str!("head.sl"), include_str!("carrier.sl")).to_owned() + reading;
    let put = |text: String, (name, number): &(&str, usize)| text.replace(&format!("{{{name}}}"), &number.to_string());
    numbers.iter().fold(text, put)
}
