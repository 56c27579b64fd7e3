//! Accessors: typed numbers in buffers.

use std::path::Path;

use super::json::{Accessor, Root};
use super::{buffer, get};
use crate::{Error, Result};

/// Maximum number of elements of an accessor without a buffer, whose elements are zero.
const MAX_EMPTY: usize = 1 << 22;

/// Reads the accessors of a file; buffers are loaded when they are needed.
pub(super) struct Accessors<'a> {
    path: &'a Path,
    root: &'a Root,
    buffers: Vec<Option<Vec<u8>>>,
}

/// Where elements are in a buffer view.
struct Span {
    view: usize,
    offset: usize,
    count: usize,
    /// Bytes of an element.
    size: usize,
}

impl<'a> Accessors<'a> {
    /// `binary` is the content of the first buffer if that has no address.
    pub(super) fn new(path: &'a Path, root: &'a Root, binary: Option<Vec<u8>>) -> Self {
        let mut buffers = vec![None; root.buffers.len()];
        if let (Some(content), Some(buffer)) = (buffers.first_mut(), root.buffers.first()) {
            *content = binary.filter(|_| buffer.uri.is_none());
        }
        Self { path, root, buffers }
    }

    /// Whether an accessor has no content of its own.
    pub(super) fn is_empty(&self, index: usize) -> bool {
        let empty = |accessor: &Accessor| accessor.buffer_view.is_none() && accessor.sparse.is_none();
        self.root.accessors.get(index).is_some_and(empty)
    }

    /// The elements of an accessor, vectors of N components; `user` is the node that names it.
    pub(super) fn vectors<const N: usize>(&mut self, index: usize, user: &str) -> Result<Vec<[f64; N]>> {
        let (path, root) = (self.path, self.root);
        let field = format!("{user}: accessor");
        let accessor = get(path, &field, &root.accessors, index)?;
        let field = format!("{field} {index}");
        let wrong = |problem: String| Error::invalid(path, &field, problem);
        let expected = ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1];
        if accessor.kind != expected {
            return Err(wrong(format!("found {}, expected {expected}", accessor.kind)));
        }
        let number = Number::new(accessor.component_type, accessor.normalized).map_err(wrong)?;
        let size = N * number.size();
        let mut elements: Vec<[f64; N]> = match accessor.buffer_view {
            Some(view) => {
                let span = Span { view, offset: accessor.byte_offset, count: accessor.count, size };
                self.elements(span, &field)?.map(|bytes| number.vector(bytes)).collect()
            }
            None if accessor.count > MAX_EMPTY => {
                let problem = format!("found {} elements without content, the limit is {MAX_EMPTY}", accessor.count);
                return Err(wrong(problem));
            }
            None => vec![[0.0; N]; accessor.count],
        };
        let Some(sparse) = &accessor.sparse else { return Ok(elements) };
        // Substitute the elements of a sparse accessor
        let of_index = Number::new(sparse.indices.component_type, false).map_err(wrong)?;
        let (view, offset, count) = (sparse.indices.buffer_view, sparse.indices.byte_offset, sparse.count);
        let span = Span { view, offset, count, size: of_index.size() };
        let places: Vec<usize> =
            self.elements(span, &field)?.map(|bytes| of_index.vector::<1>(bytes)[0] as usize).collect();
        let span = Span { view: sparse.values.buffer_view, offset: sparse.values.byte_offset, count, size };
        for (place, bytes) in places.into_iter().zip(self.elements(span, &field)?) {
            let total = elements.len();
            let missing = || wrong(format!("found the sparse index {place}, but there are {total} elements"));
            *elements.get_mut(place).ok_or_else(missing)? = number.vector(bytes);
        }
        Ok(elements)
    }

    /// The bytes of each element.
    fn elements(&mut self, span: Span, field: &str) -> Result<impl Iterator<Item = &[u8]>> {
        let (path, root) = (self.path, self.root);
        let Span { view, offset, count, size } = span;
        let view = get(path, &format!("{field}: buffer view"), &root.buffer_views, view)?;
        let buffer = get(path, &format!("{field}: buffer"), &root.buffers, view.buffer)?;
        let content = &mut self.buffers[view.buffer];
        if content.is_none() {
            let compression = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
            if let Some(name) =
                compression.iter().find(|name| view.extensions.contains_key(**name) && buffer.uri.is_none())
            {
                return Err(Error::unsupported(path, format!("{field}: {name} is not supported")));
            }
            *content = Some(buffer::load(path, view.buffer, buffer)?);
        }
        let content = content.as_deref().unwrap_or_default();
        let wrong = |problem: &str| Error::invalid(path, field, problem);
        let stride = view.byte_stride.filter(|stride| *stride != 0).unwrap_or(size);
        if stride < size {
            return Err(wrong("the stride is smaller than an element"));
        }
        let within = |start: usize, length: usize, whole: &'_ [u8]| {
            let end = start.checked_add(length)?;
            (end <= whole.len()).then_some(start..end)
        };
        let last = count.saturating_sub(1).saturating_mul(stride);
        let length = if count == 0 { 0 } else { last.saturating_add(size) };
        let range = within(view.byte_offset, view.byte_length, content);
        let bytes = range.and_then(|range| {
            let bytes = &content[range];
            within(offset, length, bytes).map(|range| &bytes[range])
        });
        let bytes = bytes.ok_or_else(|| wrong("it extends beyond its buffer"))?;
        Ok(bytes.chunks(stride).map(move |element| &element[..size]))
    }
}

/// A type of numbers.
#[derive(Clone, Copy)]
struct Number {
    kind: Kind,
    normalized: bool,
}

#[derive(Clone, Copy)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Number {
    fn new(component_type: u32, normalized: bool) -> std::result::Result<Self, String> {
        let kind = match component_type {
            5120 => Kind::I8,
            5121 => Kind::U8,
            5122 => Kind::I16,
            5123 => Kind::U16,
            5125 => Kind::U32,
            5126 => Kind::F32,
            other => return Err(format!("found the unknown component type {other}")),
        };
        Ok(Self { kind, normalized })
    }

    fn size(self) -> usize {
        match self.kind {
            Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 => 2,
            Kind::U32 | Kind::F32 => 4,
        }
    }

    /// The numbers of an element; `bytes` has exactly as many as they take.
    fn vector<const N: usize>(self, bytes: &[u8]) -> [f64; N] {
        let mut vector = [0.0; N];
        for (value, bytes) in vector.iter_mut().zip(bytes.chunks_exact(self.size())) {
            *value = self.read(bytes);
        }
        vector
    }

    fn read(self, bytes: &[u8]) -> f64 {
        fn array<const N: usize>(bytes: &[u8]) -> [u8; N] {
            std::array::from_fn(|k| bytes[k])
        }
        let (value, largest) = match self.kind {
            Kind::I8 => (f64::from(bytes[0] as i8), 127.0),
            Kind::U8 => (f64::from(bytes[0]), 255.0),
            Kind::I16 => (f64::from(i16::from_le_bytes(array(bytes))), 32_767.0),
            Kind::U16 => (f64::from(u16::from_le_bytes(array(bytes))), 65_535.0),
            Kind::U32 => (f64::from(u32::from_le_bytes(array(bytes))), f64::from(u32::MAX)),
            Kind::F32 => return f64::from(f32::from_le_bytes(array(bytes))),
        };
        if self.normalized { (value / largest).max(-1.0) } else { value }
    }
}
