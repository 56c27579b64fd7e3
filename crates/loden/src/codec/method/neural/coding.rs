//! Entropy coding of rounded planes: each number as its difference from a prediction by its neighbours.

use crate::codec::entropy::{Coder, Encoder, Numbers};

/// Ways to predict a number; each plane uses the one that takes the fewest bytes.
const PREDICTORS: u32 = 4;

/// A number predicted from those to the left, above, above left and above right.
fn predicted(predictor: u32, [left, up, corner, right]: [i32; 4]) -> i32 {
    match predictor {
        0 => 0,
        // the plane through three neighbours, within the range of two
        1 => (left + up - corner).clamp(left.min(up), left.max(up)),
        2 => (left + up) >> 1,
        _ => (2 * (left + up) + right - corner) >> 2,
    }
}

/// Codes a plane (y, x) in place with a predictor.
fn plane_by(coder: &mut impl Coder, values: &mut [i32], width: usize, predictor: u32) {
    let mut numbers = Numbers::default();
    let mut sizes = vec![0u32; values.len()];
    for place in 0..values.len() {
        let (y, x) = (place / width, place % width);
        let at = |list: &[i32], up: usize, right: usize, left: usize| {
            let inside = y >= up && x + right < width + left && x + right >= left;
            if inside { list[place + right - left - up * width] } else { 0 }
        };
        let around = |list: &[i32]| [at(list, 0, 0, 1), at(list, 1, 0, 0), at(list, 1, 0, 1), at(list, 1, 1, 0)];
        let mut guess = around(values);
        if y == 0 {
            guess = [guess[0]; 4];
        } else if x == 0 {
            (guess[0], guess[2]) = (guess[1], guess[1]);
        } else if x + 1 == width {
            guess[3] = guess[1];
        }
        let expected = predicted(predictor, guess);
        let size = |up: usize, right: usize, left: usize| {
            let inside = y >= up && x + right < width + left && x + right >= left;
            if inside { sizes[place + right - left - up * width] } else { 0 }
        };
        let near = 2 * (size(0, 0, 1) + size(1, 0, 0)) + size(1, 0, 1) + size(1, 1, 0) + size(2, 0, 0) + size(0, 0, 2);
        let difference = numbers.code(coder, values[place].wrapping_sub(expected), near, 0);
        sizes[place] = difference.unsigned_abs().min(1 << 16);
        values[place] = expected.wrapping_add(difference);
    }
}

/// The predictor of a plane as a decision for each of its bits.
fn choice(coder: &mut impl Coder, predictor: u32) -> u32 {
    let [high, low] = [2, 1].map(|bit| coder.bit(1 << 15, predictor & bit != 0));
    2 * u32::from(high) + u32::from(low)
}

/// Encodes a plane.
pub fn encode(values: &[i32], width: usize) -> Vec<u8> {
    let with = |predictor: u32| {
        let mut encoder = Encoder::default();
        choice(&mut encoder, predictor);
        plane_by(&mut encoder, &mut values.to_vec(), width, predictor);
        encoder.finish()
    };
    (0..PREDICTORS).map(with).min_by_key(Vec::len).unwrap_or_default()
}

/// Decodes a plane.
pub fn decode(coder: &mut impl Coder, values: &mut [i32], width: usize) {
    let predictor = choice(coder, 0);
    plane_by(coder, values, width, predictor);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::entropy::Decoder;

    #[test]
    fn planes_come_back() {
        for (width, height) in [(1, 1), (1, 7), (7, 1), (13, 9), (64, 64)] {
            for smooth in [false, true] {
                let value = |i: usize| match smooth {
                    true => (40.0 * ((i % width) as f32 * 0.1).sin()) as i32 + (i / width) as i32,
                    false => (i * i * 7919 % 255) as i32 - 127,
                };
                let expected: Vec<i32> = (0..width * height).map(value).collect();
                let bytes = encode(&expected, width);
                let mut found = vec![0; expected.len()];
                decode(&mut Decoder::new(&bytes), &mut found, width);
                assert_eq!(found, expected, "{width} x {height}");
                assert!(!smooth || width < 64 || bytes.len() < expected.len() / 4, "{}", bytes.len());
            }
        }
    }
}
