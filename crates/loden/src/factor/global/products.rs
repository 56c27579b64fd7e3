//! What the algorithms make of the pieces of passes: products, moments, images, and the result.

use super::{Global, Pass, Passes};
use crate::Result;
use crate::factor::linalg::{Eigen, combine_rows, fix_sign, largest_eigenpairs, product_with_transposed};

/// Eigenvalue, relative to the largest, below which a direction counts as dependent on the others: single precision.
const DEPENDENT: f64 = 1e-6;

/// The sum of each column minus its offset, and the sum of all their squares.
pub struct Moments {
    sums: Vec<f64>,
    squares: f64,
}

impl Moments {
    /// The mean of each column and the sum of squared deviations from it; a mean of 0 unless `centred`.
    pub fn mean_and_energy(&self, offset: &[f64], texels: usize, centred: bool) -> (Vec<f64>, f64) {
        if !centred {
            return (vec![0.0; offset.len()], self.squares);
        }
        let off: Vec<f64> = self.sums.iter().map(|sum| sum / texels as f64).collect();
        let energy = self.squares - texels as f64 * off.iter().map(|v| v * v).sum::<f64>();
        (off.iter().zip(offset).map(|(off, offset)| offset + off).collect(), energy)
    }
}

/// The matrix that passes read: all texels or a subsample of so many.
pub struct Scope<'a, P: ?Sized> {
    pub passes: &'a P,
    /// Mean of each column, or zeros; subtracted from all texels.
    pub offset: &'a [f64],
    /// Whether the mean of the products is subtracted.
    pub centred: bool,
    pub few: Option<usize>,
}

/// Products T of the matrix with the rows of a basis, kept where they were computed.
pub struct Products {
    stages: Vec<(usize, usize)>,
    means: Vec<f64>,
}

impl<P: Passes + ?Sized> Scope<'_, P> {
    /// Number of texels.
    pub fn texels(&self) -> usize {
        self.few.map_or(self.passes.texels(), super::start::Subsample::<()>::size)
    }

    /// Multiplies the matrix by the rows of `basis`. Computes the moments if `gather`.
    pub fn project(&self, basis: &[f64], gather: bool) -> Result<(Products, Moments)> {
        let columns = self.offset.len();
        let width = basis.len() / columns;
        let mut means = vec![0.0; width];
        let mut moments = Moments { sums: vec![0.0; columns], squares: 0.0 };
        let pass = Pass::Project { few: self.few, gather };
        let stage = self.passes.run(&pass, &[self.offset, basis], &mut |_, piece| {
            let (products, gathered) = piece.doubles.split_at(width.min(piece.doubles.len()));
            means.iter_mut().zip(products).for_each(|(sum, part)| *sum += part);
            if let Some((squares, sums)) = gathered.split_first() {
                moments.squares += squares;
                moments.sums.iter_mut().zip(sums).for_each(|(sum, part)| *sum += part);
            }
            Ok(())
        })?;
        let texels = self.texels() as f64;
        means.iter_mut().for_each(|v| *v = if self.centred { f64::from((*v / texels) as f32) } else { 0.0 });
        Ok((Products { stages: vec![(stage, width)], means }, moments))
    }

    /// The transposed matrix times the products of one stage: (component, column).
    pub fn image(&self, products: &Products) -> Result<Vec<f64>> {
        let (columns, shards) = (self.offset.len(), self.passes.shards());
        let (of_shard, width) = (columns / shards, products.width());
        let mut image = vec![0.0; width * columns];
        let pass = Pass::Image { few: self.few, products: products.stages[0] };
        let stage = self.passes.run(&pass, &[self.offset, &products.means], &mut |unit, piece| {
            let first = unit % shards * of_shard;
            for (row, sums) in image.chunks_exact_mut(columns).zip(piece.floats.chunks_exact(of_shard)) {
                row[first..first + of_shard].iter_mut().zip(sums).for_each(|(out, &sum)| *out += f64::from(sum));
            }
            Ok(())
        })?;
        self.passes.forget(stage);
        Ok(image)
    }
}

impl Products {
    fn width(&self) -> usize {
        self.means.len()
    }

    /// Appends the rows of `other`, which has the same texels.
    pub fn append(&mut self, other: Self) {
        self.stages.extend(other.stages);
        self.means.extend(other.means);
    }

    /// Drops the products.
    pub fn forget<P: Passes + ?Sized>(self, passes: &P) {
        self.stages.iter().for_each(|(stage, _)| passes.forget(*stage));
    }

    /// Inner products of all pairs of rows.
    pub fn inner<P: Passes + ?Sized>(&self, passes: &P) -> Result<Vec<f64>> {
        let mut sum = vec![0.0; self.width() * self.width()];
        passes.run(&Pass::Inner { products: self.stages.clone() }, &[&self.means], &mut |_, piece| {
            sum.iter_mut().zip(&piece.doubles).for_each(|(sum, v)| *sum += v);
            Ok(())
        })?;
        Ok(sum)
    }

    /// The first `count` singular vectors of Q^T M, where the orthonormal Q spans the columns of the products T,
    /// computed from the image and from the inner products `inner`: right singular vectors, and a rotation that makes
    /// coefficients of the products. `None` if the rank is lower.
    pub fn triplets(&self, inner: &[f64], image: &[f64], columns: usize, count: usize) -> Option<(Vec<f64>, Vec<f64>)> {
        let width = self.width();
        // normalise first: the columns of T differ in length by orders of magnitude
        let scale: Vec<f64> = (0..width).map(|k| inner[k * width + k].max(f64::MIN_POSITIVE).sqrt().recip()).collect();
        let directions: Vec<f64> =
            inner.iter().enumerate().map(|(i, v)| v * scale[i / width] * scale[i % width]).collect();
        let Eigen { values, mut vectors } = largest_eigenpairs(&directions, width, width)?;
        for (vector, value) in vectors.chunks_exact_mut(width).zip(&values) {
            // leave out directions that depend on others
            let factor = if *value > DEPENDENT * values[0] { value.sqrt().recip() } else { 0.0 };
            vector.iter_mut().zip(&scale).for_each(|(v, scale)| *v *= factor * scale);
        }
        let projected = combine_rows(&vectors, image, columns);
        let Eigen { values, vectors: rotation } =
            largest_eigenpairs(&product_with_transposed(&projected, &projected, columns), width, count)?;
        if values[count - 1] <= DEPENDENT * DEPENDENT * values[0] || values[0] <= f64::MIN_POSITIVE {
            return None;
        }
        let scaled = |power: f64| -> Vec<f64> {
            rotation.iter().enumerate().map(|(i, v)| v * values[i / width].powf(power)).collect()
        };
        Some((combine_rows(&scaled(-0.5), &projected, columns), combine_rows(&scaled(0.5), &vectors, width)))
    }

    /// The result: fixes the signs of the rows of `basis`, and applies `rotation` to the products with the same signs.
    pub fn finish<P: Passes + ?Sized>(
        self,
        passes: &P,
        mut basis: Vec<f64>,
        mut rotation: Vec<f64>,
        (mean, energy): (Vec<f64>, f64),
    ) -> Result<Global> {
        let columns = mean.len();
        for (row, rotation) in basis.chunks_exact_mut(columns).zip(rotation.chunks_exact_mut(self.width())) {
            if fix_sign(row) {
                rotation.iter_mut().for_each(|v| *v = -*v);
            }
        }
        let count = rotation.len() / self.width();
        let mut coefficients = Vec::with_capacity(passes.texels() * count);
        let pass = Pass::Rotate { products: self.stages.clone() };
        passes.run(&pass, &[&self.means, &rotation], &mut |_, piece| {
            coefficients.extend(piece.floats);
            Ok(())
        })?;
        self.forget(passes);
        Ok(Global { mean, basis, coefficients, energy })
    }
}
