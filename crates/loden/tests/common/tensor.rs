//! Tensor files, the containers of `.bsdf` and `.pbsdf`.

/// An array: name, number type as the file names it, shape, bytes.
pub type Field<'a> = (&'a str, u8, Vec<u64>, Vec<u8>);

pub fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

pub fn file(fields: &[Field]) -> Vec<u8> {
    let mut bytes = b"tensor_file\0\x01\0".to_vec();
    bytes.extend((fields.len() as u32).to_le_bytes());
    let head: usize = fields.iter().map(|f| 13 + f.0.len() + 8 * f.2.len()).sum();
    let mut at = bytes.len() + head;
    for (name, number, shape, content) in fields {
        bytes.extend((name.len() as u16).to_le_bytes());
        bytes.extend(name.as_bytes());
        bytes.extend((shape.len() as u16).to_le_bytes());
        bytes.push(*number);
        bytes.extend((at as u64).to_le_bytes());
        shape.iter().for_each(|n| bytes.extend(n.to_le_bytes()));
        at += content.len();
    }
    fields.iter().for_each(|f| bytes.extend(&f.3));
    bytes
}
