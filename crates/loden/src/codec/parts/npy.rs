//! Arrays in NumPy's `.npy` format, version 1, little endian, C order.

use std::fs;
use std::path::Path;

use half::f16;

use super::Numbers;
use crate::btf::SampleType;
use crate::codec::container::TensorSpec;
use crate::{Error, Result};

const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";

/// NumPy's name of the type.
fn descr(sample_type: Option<SampleType>) -> &'static str {
    match sample_type {
        Some(SampleType::U8) => "|u1",
        Some(SampleType::F16) => "<f2",
        Some(SampleType::F32) => "<f4",
        None => "<u2",
    }
}

fn header(sample_type: Option<SampleType>, shape: &[usize]) -> String {
    // a tuple of one element ends with a comma
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let shape = if shape.matches(',').count() == 1 { shape.trim_end() } else { shape.trim_end_matches(", ") };
    format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({shape}), }}", descr(sample_type))
}

/// The content of a file.
pub fn write(numbers: &Numbers, shape: &[usize]) -> Vec<u8> {
    let mut text = header(numbers.sample_type(), shape).into_bytes();
    let length = (MAGIC.len() + 2 + text.len() + 1).next_multiple_of(64) - MAGIC.len() - 2;
    text.resize(length - 1, b' ');
    text.push(b'\n');
    [MAGIC, &(length as u16).to_le_bytes(), &text, &numbers.stored(2)].concat()
}

/// The numbers of a file, which must match the type and shape of a tensor.
///
/// # Errors
/// [`Error::Invalid`] naming the file and the field; [`Error::Io`].
pub fn read(path: &Path, spec: &TensorSpec) -> Result<Numbers> {
    let bytes = fs::read(path).map_err(Error::io(path))?;
    let invalid = |field: &str, problem: String| Error::invalid(path, field, problem);
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| invalid("magic", "not a version 1 .npy file".into()))?;
    let length = rest.get(..2).and_then(|b| b.try_into().ok()).map(u16::from_le_bytes);
    let length = length.map(usize::from).filter(|length| rest.len() >= 2 + length);
    let length = length.ok_or_else(|| invalid("header", "it is cut off".into()))?;
    let (text, data) = rest[2..].split_at(length);
    let text = String::from_utf8_lossy(text);
    // other programs use different spacing
    let plain = |text: &str| {
        text.chars().filter(|c| !c.is_whitespace()).collect::<String>().replace(",)", ")").replace(",}", "}")
    };
    let expected = header(Some(spec.sample_type), &spec.shape);
    if plain(&text) != plain(&expected) {
        return Err(invalid("header", format!("found {}, expected {expected}", text.trim())));
    }
    if data.len() as u64 != spec.bytes() {
        return Err(invalid("data", format!("found {} bytes, expected {}", data.len(), spec.bytes())));
    }
    Ok(match spec.sample_type {
        SampleType::U8 => Numbers::U8(data.to_vec().into()),
        SampleType::F16 => {
            let number = |b: &[u8]| f16::from_bits(b.iter().rev().fold(0, |bits, &byte| bits << 8 | u16::from(byte)));
            Numbers::F16(data.chunks_exact(2).map(number).collect::<Vec<f16>>().into())
        }
        SampleType::F32 => {
            let number = |b: &[u8]| f32::from_bits(b.iter().rev().fold(0, |bits, &byte| bits << 8 | u32::from(byte)));
            Numbers::F32(data.chunks_exact(4).map(number).collect::<Vec<f32>>().into())
        }
    })
}
