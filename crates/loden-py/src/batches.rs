//! The class `Batches`: measured values at random.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{Vec2, Vec3};
use loden::btf::{BtfSource, Texels};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arrays::{Floats, room, shaped};
use crate::errors::wrong;
use crate::work::{How, run};

/// Endless batches of measured values, made by `Btf.batches`.
#[pyclass(module = "loden", frozen)]
pub(crate) struct Batches {
    source: Arc<dyn BtfSource>,
    n: usize,
    seed: u64,
    reuse: usize,
    threads: Option<usize>,
    /// Number of batches so far.
    batch: AtomicU64,
}

type Batch<'py> = [Floats<'py>; 4];

/// Arrays of one image's share of a batch.
struct Share<'a> {
    uv: &'a mut [Vec2],
    wi: &'a mut [Vec3],
    wo: &'a mut [Vec3],
    values: &'a mut [Vec3],
}

impl Batches {
    pub(crate) fn new(
        py: Python<'_>,
        source: Arc<dyn BtfSource>,
        n: usize,
        seed: u64,
        reuse: usize,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        for (name, number) in [("n", n), ("reuse", reuse)] {
            if number == 0 {
                return Err(wrong(py, name, "found 0, expected 1 or more"));
            }
        }
        Ok(Self { source, n, seed, reuse, threads, batch: AtomicU64::new(0) })
    }

    /// Draws texels of one random image that was measured.
    fn draw(&self, seed: u64, share: Share<'_>) -> loden::Result<()> {
        let meta = self.source.meta();
        let mut random = fastrand::Rng::with_seed(seed);
        let (view, light) = loop {
            let pair = (random.usize(..meta.views.len()), random.usize(..meta.lights.len()));
            if !self.source.missing().contains(&pair) {
                break pair;
            }
        };
        let image = self.source.image(view, light)?;
        let size = Vec2::new(meta.width as f32, meta.height as f32);
        let Share { uv, wi, wo, values } = share;
        wi.fill(meta.lights.directions()[light]);
        wo.fill(meta.views.directions()[view]);
        for (uv, value) in uv.iter_mut().zip(values) {
            let (x, y) = (random.usize(..meta.width), random.usize(..meta.height));
            let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / size;
            *uv = Vec2::new(at.x, 1.0 - at.y);
            *value = stored(&image, 3 * (y * meta.width + x)).map(|v| meta.encoding.decode(v));
        }
        Ok(())
    }
}

/// The encoded value of the texel whose first number is at index `i`.
fn stored(texels: &Texels<'_>, i: usize) -> Vec3 {
    match texels {
        Texels::U8(v) => Vec3::new(f32::from(v[i]), f32::from(v[i + 1]), f32::from(v[i + 2])) / 255.0,
        Texels::F16(v) => Vec3::new(v[i].to_f32(), v[i + 1].to_f32(), v[i + 2].to_f32()),
        Texels::F32(v) => Vec3::new(v[i], v[i + 1], v[i + 2]),
    }
}

#[pymethods]
impl Batches {
    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Batch<'py>> {
        let batch = self.batch.fetch_add(1, Ordering::Relaxed);
        let first = batch.wrapping_mul(self.n.div_ceil(self.reuse) as u64);
        let mut arrays = [room(2 * self.n)?, room(3 * self.n)?, room(3 * self.n)?, room(3 * self.n)?];
        let [uv, wi, wo, values] = &mut arrays;
        let uv: &mut [Vec2] = bytemuck::cast_slice_mut(uv);
        let [wi, wo, values] = [wi, wo, values].map(|array| bytemuck::cast_slice_mut::<f32, Vec3>(array));
        let reuse = self.reuse;
        run(py, &How::threads(self.threads), |_| {
            let shares = uv
                .par_chunks_mut(reuse)
                .zip(wi.par_chunks_mut(reuse))
                .zip(wo.par_chunks_mut(reuse).zip(values.par_chunks_mut(reuse)));
            shares.enumerate().try_for_each(|(k, ((uv, wi), (wo, values)))| {
                // a seed of each image: the order of threads does not matter
                let seed = self.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (first + k as u64);
                self.draw(seed, Share { uv, wi, wo, values })
            })
        })?;
        let [uv, wi, wo, values] = arrays;
        Ok([
            shaped(py, uv, &[self.n, 2])?,
            shaped(py, wi, &[self.n, 3])?,
            shaped(py, wo, &[self.n, 3])?,
            shaped(py, values, &[self.n, 3])?,
        ])
    }
}
