//! Which texels of a row get which of several rows.
//!
//! # Model
//! The rows that take the place of one, from dark to bright, go to its texels in the order of how bright their surroundings are. Texels in
//! surroundings that are equally bright come in random order, which depends on nothing but their place.

use super::{Matching, Rows, select};
use crate::random::hash;

/// Texels on either side whose brightness counts.
const AROUND: usize = 2;

impl Matching {
    /// For each texel of `from` the row of `to` that takes the place of its own.
    pub fn texels(&self, from: &Rows, to: &Rows) -> Vec<u16> {
        let mut texels: Vec<u16> = from.index().iter().map(|row| self.rows[usize::from(*row)] as u16).collect();
        if self.shares.iter().all(|shares| shares.len() < 2) {
            return texels;
        }
        let around = surroundings(from);
        let lightness: Vec<f64> = (0..to.count()).map(|row| select::mean_color(to, row)[0]).collect();
        let mut members = vec![Vec::new(); from.count()];
        from.index().iter().enumerate().for_each(|(texel, row)| members[usize::from(*row)].push(texel));
        for (mut members, shares) in members.into_iter().zip(&self.shares).filter(|(_, shares)| shares.len() > 1) {
            members.sort_by(|a, b| around[*a].total_cmp(&around[*b]).then(hash(&[*a as u64]).cmp(&hash(&[*b as u64]))));
            let mut shares = shares.clone();
            shares.sort_by(|a, b| lightness[a.0].total_cmp(&lightness[b.0]));
            let (mut so_far, mut begin) = (0.0, 0);
            for (row, share) in shares {
                so_far += share;
                // rounding the sums loses no texel
                let end = ((so_far * members.len() as f64).round() as usize).min(members.len());
                members[begin..end].iter().for_each(|texel| texels[*texel] = row as u16);
                begin = end;
            }
        }
        texels
    }
}

/// The mean lightness around each texel; texels beyond an edge are those of the opposite one.
fn surroundings(rows: &Rows) -> Vec<f64> {
    let (width, height) = (rows.meta().width, rows.meta().height);
    let lightness: Vec<f64> = (0..rows.count()).map(|row| select::mean_color(rows, row)[0]).collect();
    let own: Vec<f64> = rows.index().iter().map(|row| lightness[usize::from(*row)]).collect();
    let sum = |at: &dyn Fn(usize) -> f64, count: usize, middle: usize| -> f64 {
        (0..=2 * AROUND).map(|k| at((middle + k + AROUND * (count - 1)) % count)).sum()
    };
    let across: Vec<f64> =
        (0..width * height).map(|texel| sum(&|x| own[texel / width * width + x], width, texel % width)).collect();
    (0..width * height).map(|texel| sum(&|y| across[y * width + texel % width], height, texel / width)).collect()
}
