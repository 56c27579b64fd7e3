//! The container of `.bsdf` and `.pbsdf` files: named arrays.

use std::ops::Range;
use std::path::{Path, PathBuf};

use half::f16;
use memmap2::Mmap;

use crate::input::{Cursor, map};
use crate::{Error, Result};

pub(crate) const MAGIC: &[u8; 12] = b"tensor_file\0";
/// Maximum number of arrays, and of axes of an array.
const MAX_COUNT: u32 = 256;

/// An opened file, whose arrays are read on demand.
pub(super) struct TensorFile {
    path: PathBuf,
    map: Mmap,
    fields: Vec<Field>,
}

struct Field {
    name: String,
    /// Code of the number type: 1 u8 .. 8 i64, 9 f16, 10 f32, 11 f64.
    number: u8,
    shape: Vec<usize>,
    bytes: Range<usize>,
}

impl TensorFile {
    pub(super) fn open(path: &Path) -> Result<Self> {
        let map = map(path)?;
        let mut cursor = Cursor::new(path, &map);
        if cursor.take("signature", 12)? != MAGIC {
            return Err(Error::invalid(path, "signature", "not a tensor file"));
        }
        let version = [cursor.u8("version")?, cursor.u8("version")?];
        if version[0] != 1 {
            return Err(Error::unsupported(
                path,
                format!("unsupported tensor file version {}.{}", version[0], version[1]),
            ));
        }
        let count = cursor.u32("number of fields")?;
        if count > MAX_COUNT {
            return Err(Error::invalid(
                path,
                "number of fields",
                format!("found {count}, expected at most {MAX_COUNT}"),
            ));
        }
        let fields = (0..count).map(|_| field(&mut cursor, map.len())).collect::<Result<_>>()?;
        Ok(Self { path: path.into(), map, fields })
    }

    fn find(&self, name: &str) -> Result<&Field> {
        let field = self.fields.iter().find(|field| field.name == name);
        field.ok_or_else(|| Error::invalid(&self.path, name, "the file has no such field"))
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.fields.iter().any(|field| field.name == name)
    }

    pub(super) fn shape(&self, name: &str) -> Result<&[usize]> {
        self.find(name).map(|field| field.shape.as_slice())
    }

    /// The shape of an array of `N` axes.
    pub(super) fn sizes<const N: usize>(&self, name: &str) -> Result<[usize; N]> {
        let shape = self.shape(name)?;
        shape
            .try_into()
            .map_err(|_| Error::invalid(&self.path, name, format!("found shape {shape:?}, expected {N} axes")))
    }

    /// The numbers of an array of any type.
    pub(super) fn numbers(&self, name: &str) -> Result<Vec<f32>> {
        let field = self.find(name)?;
        let bytes = &self.map[field.bytes.clone()];
        fn each<const N: usize>(bytes: &[u8], value: impl Fn([u8; N]) -> f32) -> Vec<f32> {
            bytes.as_chunks::<N>().0.iter().map(|chunk| value(*chunk)).collect()
        }
        Ok(match field.number {
            1 => each(bytes, |[b]| f32::from(b)),
            2 => each(bytes, |[b]| f32::from(b as i8)),
            3 => each(bytes, |b| f32::from(u16::from_le_bytes(b))),
            4 => each(bytes, |b| f32::from(i16::from_le_bytes(b))),
            5 => each(bytes, |b| u32::from_le_bytes(b) as f32),
            6 => each(bytes, |b| i32::from_le_bytes(b) as f32),
            7 => each(bytes, |b| u64::from_le_bytes(b) as f32),
            8 => each(bytes, |b| i64::from_le_bytes(b) as f32),
            9 => each(bytes, |b| f16::from_le_bytes(b).to_f32()),
            10 => each(bytes, f32::from_le_bytes),
            _ => each(bytes, |b| f64::from_le_bytes(b) as f32),
        })
    }

    /// The bytes of an array as text; empty if there is none.
    pub(super) fn text(&self, name: &str) -> String {
        let bytes = self.find(name).map(|field| &self.map[field.bytes.clone()]).unwrap_or_default();
        String::from_utf8_lossy(bytes).into_owned()
    }
}

fn field(cursor: &mut Cursor<'_>, file_len: usize) -> Result<Field> {
    let length = cursor.u16("length of a field's name")?;
    let name = cursor.text("name of a field", length.into())?;
    let axes = cursor.u16(&name)?;
    let number = cursor.u8(&name)?;
    let size = match number {
        1 | 2 => 1,
        3 | 4 | 9 => 2,
        5 | 6 | 10 => 4,
        7 | 8 | 11 => 8,
        _ => return Err(cursor.invalid(&name, format!("found number type {number}, expected 1 to 11"))),
    };
    if u32::from(axes) > MAX_COUNT {
        return Err(cursor.invalid(&name, format!("{axes} axes")));
    }
    let offset = cursor.u64(&name)?;
    let shape: Vec<u64> = (0..axes).map(|_| cursor.u64(&name)).collect::<Result<_>>()?;
    let bytes = shape.iter().try_fold(size, |product: u64, &n| product.checked_mul(n));
    match bytes.and_then(|bytes| Some((offset, offset.checked_add(bytes)?))) {
        Some((start, end)) if end <= file_len as u64 => {
            let shape = shape.iter().map(|&n| n as usize).collect();
            Ok(Field { name, number, shape, bytes: start as usize..end as usize })
        }
        _ => {
            Err(cursor.invalid(&name, format!("shape {shape:?} at byte {offset} exceeds the file of {file_len} bytes")))
        }
    }
}
