//! Which rows or texels an edit changes.

use glam::Vec3;

use super::Rows;
use super::rows::MAX_ROWS;
use crate::metric::lab;
use crate::{Error, Result};

/// Which part of a material is edited.
#[derive(Debug, Clone, PartialEq)]
pub enum Selection {
    /// Every row.
    All,
    /// Rows by their numbers.
    Rows(Vec<usize>),
    /// Rows whose mean colour is near one.
    Colors {
        /// The colour, linear.
        center: Vec3,
        /// The largest difference in CIE Lab.
        radius: f64,
    },
    /// Texels, shape (y, x).
    Mask(Vec<bool>),
    /// The texels around one that are connected with it and whose mean colour is near its own.
    Grow {
        /// Column.
        x: usize,
        /// Row of texels from the top.
        y: usize,
        /// The largest difference in CIE Lab.
        radius: f64,
    },
}

/// The rows that change, among those of the new material.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Chosen {
    /// The new row of each texel.
    pub index: Vec<u16>,
    /// The old row of each new row.
    pub origin: Vec<usize>,
    /// New rows that change, and the old rows they are made of.
    pub changed: Vec<(usize, usize)>,
}

impl Selection {
    /// The rows that change.
    pub(super) fn rows(&self, rows: &Rows) -> Result<Chosen> {
        let whole = |chosen: Vec<usize>| Chosen {
            index: rows.index().to_vec(),
            origin: (0..rows.count()).collect(),
            changed: chosen.into_iter().map(|row| (row, row)).collect(),
        };
        match self {
            Self::All => Ok(whole((0..rows.count()).collect())),
            Self::Rows(list) => {
                if let Some(row) = list.iter().find(|row| **row >= rows.count()) {
                    return Err(Error::parameter("rows", format!("found {row}, expected less than {}", rows.count())));
                }
                let mut list = list.clone();
                list.sort_unstable();
                list.dedup();
                Ok(whole(list))
            }
            Self::Colors { center, radius } => {
                let center = lab(center.to_array().map(f64::from));
                let near = |row: &usize| difference(mean_color(rows, *row), center) <= *radius;
                let near: Vec<usize> = (0..rows.count()).filter(near).collect();
                match near.is_empty() {
                    true => Err(Error::parameter("colors", "no row has such a mean colour")),
                    false => Ok(whole(near)),
                }
            }
            Self::Mask(mask) if mask.len() != rows.index().len() => {
                let problem = format!("found {} texels, expected {}", mask.len(), rows.index().len());
                Err(Error::parameter("mask", problem))
            }
            Self::Mask(mask) => split(rows, mask),
            Self::Grow { x, y, radius } => split(rows, &grown(rows, [*x, *y], *radius)?),
        }
    }
}

/// Gives the texels of a mask rows of their own where others share theirs.
fn split(rows: &Rows, mask: &[bool]) -> Result<Chosen> {
    let (mut inside, mut outside) = (vec![false; rows.count()], vec![false; rows.count()]);
    for (row, inner) in rows.index().iter().zip(mask) {
        let side = if *inner { &mut inside } else { &mut outside };
        side[usize::from(*row)] = true;
    }
    let mut origin: Vec<usize> = (0..rows.count()).collect();
    let mut place: Vec<usize> = origin.clone();
    let mut changed = Vec::new();
    for row in (0..rows.count()).filter(|&row| inside[row]) {
        if outside[row] {
            place[row] = origin.len();
            origin.push(row);
        }
        changed.push((place[row], row));
    }
    if changed.is_empty() {
        return Err(Error::parameter("mask", "chooses no texel"));
    }
    if origin.len() > MAX_ROWS {
        return Err(Error::parameter("mask", format!("needs {} rows, at most {MAX_ROWS} are possible", origin.len())));
    }
    let row = |(row, inner): (&u16, &bool)| if *inner { place[usize::from(*row)] as u16 } else { *row };
    let index = rows.index().iter().zip(mask).map(row).collect();
    Ok(Chosen { index, origin, changed })
}

/// The texels connected with one by sides whose mean colours differ from its own by at most `radius`.
fn grown(rows: &Rows, [x, y]: [usize; 2], radius: f64) -> Result<Vec<bool>> {
    let (width, height) = (rows.meta().width, rows.meta().height);
    if x >= width || y >= height {
        let problem = format!("found texel {x},{y}, the material has {width} x {height}");
        return Err(Error::parameter("grow", problem));
    }
    let seed = mean_color(rows, rows.index()[y * width + x].into());
    let near: Vec<bool> = (0..rows.count()).map(|row| difference(mean_color(rows, row), seed) <= radius).collect();
    let mut mask = vec![false; width * height];
    let mut open = vec![[x, y]];
    mask[y * width + x] = true;
    while let Some([x, y]) = open.pop() {
        let around = [[x.wrapping_sub(1), y], [x + 1, y], [x, y.wrapping_sub(1)], [x, y + 1]];
        for [x, y] in around.into_iter().filter(|[x, y]| *x < width && *y < height) {
            let texel = y * width + x;
            if !mask[texel] && near[usize::from(rows.index()[texel])] {
                mask[texel] = true;
                open.push([x, y]);
            }
        }
    }
    Ok(mask)
}

/// The mean colour of a row in CIE Lab.
pub(super) fn mean_color(rows: &Rows, row: usize) -> [f64; 3] {
    let values = rows.values(row);
    let sum = values.iter().fold([0.0; 3], |sum: [f64; 3], v| std::array::from_fn(|c| sum[c] + f64::from(v[c])));
    lab(sum.map(|v| (v / values.len() as f64).max(0.0)))
}

fn difference(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}
