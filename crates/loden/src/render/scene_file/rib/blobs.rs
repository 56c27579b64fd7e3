//! The instructions of `Blobby`.

use glam::{Mat4, Vec3};

use super::request::{Argument, Request, RibResult};
use crate::render::geometry::Instruction;

/// The field of a request, and the number of instructions that have no effect here.
pub(super) fn field(request: &Request) -> RibResult<(Vec<Instruction>, usize)> {
    let codes = request.integers(1)?;
    let floats: &[f32] = match request.arguments.get(2) {
        Some(Argument::Numbers(list)) => list,
        Some(Argument::Texts(list)) if list.is_empty() => &[],
        found => return Err(format!("argument 3: found {found:?}, expected an array of numbers")),
    };
    let mut reader = Codes { codes: &codes, floats };
    let (mut field, mut ignored) = (Vec::new(), 0);
    while let Some(code) = reader.next() {
        field.push(match code {
            1000 => Instruction::Constant(reader.numbers::<1>()?[0]),
            1001 => {
                let [blob_from_object, object_from_blob] = matrices(&reader.numbers::<16>()?)?;
                Instruction::Ellipsoid { blob_from_object, object_from_blob }
            }
            1002 => {
                let n = reader.numbers::<23>()?;
                let [blob_from_object, object_from_blob] = matrices(&n[7..])?;
                let ends = [Vec3::from_slice(&n[..3]), Vec3::from_slice(&n[3..6])];
                Instruction::Segment { ends, radius: n[6], blob_from_object, object_from_blob }
            }
            1003 => {
                // A plane with a depth map repels; without the map it does nothing.
                reader.next();
                reader.next();
                ignored += 1;
                Instruction::Constant(0.0)
            }
            0..=3 => {
                let count = reader.operand()?;
                let list = (0..count).map(|_| reader.operand()).collect::<RibResult<Vec<usize>>>()?;
                match code {
                    0 => Instruction::Add(list),
                    1 => Instruction::Multiply(list),
                    2 => Instruction::Max(list),
                    _ => Instruction::Min(list),
                }
            }
            4 => Instruction::Divide([reader.operand()?, reader.operand()?]),
            5 => Instruction::Subtract([reader.operand()?, reader.operand()?]),
            6 => Instruction::Negate(reader.operand()?),
            7 => Instruction::Same(reader.operand()?),
            other => return Err(format!("found the code {other}, expected 0 to 7 or 1000 to 1003")),
        });
    }
    Ok((field, ignored))
}

struct Codes<'a> {
    codes: &'a [u32],
    floats: &'a [f32],
}

impl Codes<'_> {
    fn next(&mut self) -> Option<u32> {
        let (first, rest) = self.codes.split_first()?;
        self.codes = rest;
        Some(*first)
    }

    fn operand(&mut self) -> RibResult<usize> {
        self.next().map(|code| code as usize).ok_or_else(|| "an instruction has too few operands".into())
    }

    /// The numbers at the place that the next code gives.
    fn numbers<const N: usize>(&mut self) -> RibResult<[f32; N]> {
        let at = self.operand()?;
        let found = self.floats.get(at..).and_then(|rest| rest.first_chunk::<N>());
        found.copied().ok_or_else(|| format!("found {} numbers, expected {N} from {at} on", self.floats.len()))
    }
}

fn matrices(numbers: &[f32]) -> RibResult<[Mat4; 2]> {
    let object_from_blob = Mat4::from_cols_slice(numbers);
    let blob_from_object = object_from_blob.inverse();
    if object_from_blob.is_finite() && blob_from_object.is_finite() {
        Ok([blob_from_object, object_from_blob])
    } else {
        Err("the matrix of a blob is singular".into())
    }
}
