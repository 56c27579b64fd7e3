//! Local principal components: clusters of points that lie near affine subspaces.
//!
//! Choose it over [`super::kmeans`] where points of a cluster still vary along a few directions.
//!
//! # Model
//! Each cluster has a mean m and c orthonormal components U; the squared distance of a point x to it is |x - m|^2 - |U
//! (x - m)|^2. Points join the nearest cluster and means and components are recomputed from the points, in turn, until
//! no point moves or the iterations are used up. k-means gives the initial clusters.
//!
//! # Limits
//! Finds a local minimum. Products are summed in single precision.
//!
//! # References
//! kambhatla1997, mueller2003

use rayon::prelude::*;

use super::kmeans::{Partition, Points, Start, kmeans};
use super::linalg::{Rows, add_product_transposed, largest_eigenpairs};
use crate::Result;

/// Iterations of k-means for the initial clusters.
const FIRST_ITERATIONS: usize = 15;

/// Points whose products are computed at once.
const TOGETHER: usize = 128;

/// Clusters, and the coefficients of each point in the components of its cluster.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalComponents {
    /// The cluster of each point.
    pub partition: Partition,
    /// (point, component): of mean 0 and uncorrelated within a cluster, largest variance first.
    pub coefficients: Vec<f32>,
}

/// Divides `values` (point, dimension) into at most `clusters` clusters with `components` components each, which must
/// not exceed the dimensions. Calls `step` after each iteration. `None` if a number is not finite.
///
/// # Errors
/// Errors of `step`.
pub fn local_components(
    values: &[f32],
    dimensions: usize,
    clusters: usize,
    components: usize,
    iterations: usize,
    seed: u64,
    step: &dyn Fn() -> Result<()>,
) -> Result<Option<LocalComponents>> {
    let points = Points::new(values, dimensions);
    let mut partition = kmeans(&points, clusters, Start::Distant(seed), FIRST_ITERATIONS, &|| Ok(()))?;
    drop(points);
    for _ in 0..iterations {
        let Some(spaces) = spaces(values, dimensions, &partition, components) else { return Ok(None) };
        let next = nearest(values, dimensions, &spaces);
        step()?;
        if next == partition.index {
            break;
        }
        // drop empty clusters
        partition = Partition { index: next, clusters: spaces.len() }.ordered(|members| f64::from(members[0]));
    }
    let Some(spaces) = spaces(values, dimensions, &partition, components) else { return Ok(None) };
    let mut coefficients = vec![0.0; values.len() / dimensions * components];
    coefficients
        .par_chunks_exact_mut(components)
        .zip(values.par_chunks_exact(dimensions))
        .zip(&partition.index)
        .for_each(|((out, point), &cluster)| {
            let space = &spaces[cluster as usize];
            for (out, row) in out.iter_mut().zip(space.rows.chunks_exact(dimensions).skip(1)) {
                let product = |(u, (x, m)): (&f32, (&f32, &f32))| f64::from(*u) * f64::from(x - m);
                *out = row.iter().zip(point.iter().zip(&space.rows)).map(product).sum::<f64>() as f32;
            }
        });
    Ok(Some(LocalComponents { partition, coefficients }))
}

/// An affine subspace.
struct Space {
    /// Mean, then components: (row, dimension). Components beyond the rank of the points are zero.
    rows: Vec<f32>,
    /// Products of the rows with the mean.
    at_mean: Vec<f32>,
}

fn spaces(values: &[f32], dimensions: usize, partition: &Partition, components: usize) -> Option<Vec<Space>> {
    let of_cluster = |members: &Vec<u32>| {
        let n = members.len();
        let mut rows = vec![0.0f32; (1 + components) * dimensions];
        let mut mean = vec![0.0f64; dimensions];
        for &p in members {
            mean.iter_mut().zip(&values[p as usize * dimensions..]).for_each(|(m, &v)| *m += f64::from(v) / n as f64);
        }
        // (dimension, point)
        let mut centred = vec![0.0f32; dimensions * n];
        for (i, &p) in members.iter().enumerate() {
            for (d, (&v, m)) in values[p as usize * dimensions..].iter().zip(&mean).enumerate() {
                centred[d * n + i] = (f64::from(v) - m) as f32;
            }
        }
        let mut scatter = vec![0.0f32; dimensions * dimensions];
        add_product_transposed(Rows::new(&centred, n), Rows::new(&centred, n), &mut scatter);
        let symmetric: Vec<f64> = (0..scatter.len())
            .map(|i| 0.5 * f64::from(scatter[i] + scatter[i % dimensions * dimensions + i / dimensions]))
            .collect();
        let eigen = largest_eigenpairs(&symmetric, dimensions, components)?;
        rows.iter_mut().zip(&mean).for_each(|(out, &m)| *out = m as f32);
        // below this, a component is only rounding error of the products and the numbers
        let squares: f64 =
            members.iter().map(|&p| squared_norm(&values[p as usize * dimensions..][..dimensions])).sum();
        let least = (1e-6 * eigen.values[0]).max(1e-10 * squares);
        for (k, _) in eigen.values.iter().enumerate().filter(|(_, value)| **value > least) {
            let vector = &eigen.vectors[k * dimensions..(k + 1) * dimensions];
            rows[(1 + k) * dimensions..].iter_mut().zip(vector).for_each(|(out, &v)| *out = v as f32);
        }
        let at_mean =
            rows.chunks_exact(dimensions).map(|row| row.iter().zip(&rows).map(|(a, b)| a * b).sum()).collect();
        Some(Space { rows, at_mean })
    };
    partition.members().par_iter().map(of_cluster).collect()
}

fn squared_norm(values: &[f32]) -> f64 {
    values.iter().map(|&v| f64::from(v).powi(2)).sum()
}

/// The nearest subspace of each point; the first of equals.
fn nearest(values: &[f32], dimensions: usize, spaces: &[Space]) -> Vec<u32> {
    let rows: Vec<f32> = spaces.iter().flat_map(|space| &space.rows).copied().collect();
    let each = rows.len() / dimensions / spaces.len();
    let mut index = vec![0; values.len() / dimensions];
    index.par_chunks_mut(TOGETHER).zip(values.par_chunks(TOGETHER * dimensions)).for_each(|(index, points)| {
        let mut products = vec![0.0f32; index.len() * spaces.len() * each];
        add_product_transposed(Rows::new(points, dimensions), Rows::new(&rows, dimensions), &mut products);
        for (index, products) in index.iter_mut().zip(products.chunks_exact(spaces.len() * each)) {
            let mut least = f32::INFINITY;
            for (k, (space, products)) in spaces.iter().zip(products.chunks_exact(each)).enumerate() {
                // without |x|^2, which is the same for all
                let mut distance = space.at_mean[0] - 2.0 * products[0];
                for (product, at_mean) in products.iter().zip(&space.at_mean).skip(1) {
                    distance -= (product - at_mean) * (product - at_mean);
                }
                if distance < least {
                    least = distance;
                    *index = k as u32;
                }
            }
        }
    });
    index
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points near a line and a plane that lie far apart, with a little noise.
    fn cloud() -> Vec<f32> {
        let noise = |i: usize| ((i.wrapping_mul(0x9E37_79B9) >> 9) % 1000) as f32 / 1000.0 - 0.5;
        let point = |i: usize| {
            let (a, b) = (4.0 * noise(i), 4.0 * noise(i + 7777));
            let at = if i.is_multiple_of(2) { [a, a, 3.0, 0.0, -a] } else { [a, b, -3.0, a - b, 1.0] };
            at.map(|v| v + 0.01 * noise(i * 31 + 5))
        };
        (0..1000).flat_map(point).collect()
    }

    #[test]
    fn a_line_and_a_plane_are_separated() {
        let values = cloud();
        let found = local_components(&values, 5, 2, 2, 30, 1, &|| Ok(())).unwrap().unwrap();
        assert!(found.partition.index.iter().enumerate().all(|(i, &k)| k == (i % 2) as u32));
        // coefficients are centred and uncorrelated
        for members in found.partition.members() {
            let score = |p: &u32, k: usize| f64::from(found.coefficients[*p as usize * 2 + k]);
            let sum = |f: &dyn Fn(&u32) -> f64| members.iter().map(f).sum::<f64>() / members.len() as f64;
            assert!(sum(&|p| score(p, 0)).abs() < 1e-5 && sum(&|p| score(p, 1)).abs() < 1e-5);
            assert!(sum(&|p| score(p, 0) * score(p, 1)).abs() < 1e-4);
            assert!(sum(&|p| score(p, 0).powi(2)) >= sum(&|p| score(p, 1).powi(2)));
        }
    }

    #[test]
    fn threads_change_nothing_and_components_beyond_the_rank_are_zero() {
        let values = cloud();
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| local_components(&values, 5, 6, 5, 10, 3, &|| Ok(()))).unwrap().unwrap()
        };
        assert!(run(1) == run(2));
        let few = local_components(&values[..15], 5, 2, 5, 9, 1, &|| Ok(())).unwrap().unwrap();
        assert!(few.coefficients.chunks_exact(5).all(|a| a[2..] == [0.0; 3]), "{few:?}");
        assert!(local_components(&[f32::NAN; 20], 5, 2, 1, 9, 1, &|| Ok(())).unwrap().is_none());
    }
}
