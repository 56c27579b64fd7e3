use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

use super::*;
use crate::Error;

/// A matrix (texel, column) in memory.
struct Memory {
    values: Vec<f32>,
    shards: usize,
    columns: usize,
}

impl Shards for Memory {
    type Shard<'a> = usize;

    fn count(&self) -> usize {
        self.shards
    }

    fn columns(&self) -> usize {
        self.columns
    }

    fn texels(&self) -> usize {
        self.values.len() / (self.shards * self.columns)
    }

    fn read(&self, shard: usize, _texels: Range<usize>) -> Result<usize> {
        Ok(shard)
    }

    fn load(&self, &shard: &usize, tile: &mut FloatTile, first: usize, count: usize, less: &[f64]) {
        let all = self.shards * self.columns;
        for column in 0..self.columns {
            let row = &mut tile.rgb_mut(column / 3)[column % 3];
            row.fill(0.0);
            for (t, out) in row[..count].iter_mut().enumerate() {
                *out = self.values[(first + t) * all + shard * self.columns + column];
            }
        }
        tile.centre(count, less);
    }

    fn done(&self, _shard: usize) -> Result<()> {
        Ok(())
    }
}

/// Runs passes over shards in this process.
struct Here<'a, S> {
    shards: &'a S,
    /// What passes have kept.
    kept: RefCell<Vec<BTreeMap<usize, Arc<Vec<f32>>>>>,
}

impl<S: Shards> Passes for Here<'_, S> {
    fn shards(&self) -> usize {
        self.shards.count()
    }

    fn columns(&self) -> usize {
        self.shards.columns() * self.shards.count()
    }

    fn texels(&self) -> usize {
        self.shards.texels()
    }

    fn run(&self, pass: &Pass, arrays: &[&[f64]], each: Receive) -> Result<usize> {
        let before = self.kept.borrow().clone();
        let kept = |stage: usize, unit: usize| {
            let found = before.get(stage).and_then(|units| units.get(&unit)).cloned();
            found.ok_or_else(|| Error::parameter("stage", format!("stage {stage} has kept nothing of unit {unit}")))
        };
        let units = pass.units(self.shards.count(), self.shards.columns(), self.shards.texels());
        let mut own = BTreeMap::new();
        passes::run(self.shards, pass, arrays, &kept, 0..units, &mut |unit, mut piece| {
            own.insert(unit, Arc::new(std::mem::take(&mut piece.kept)));
            each(unit, piece)
        })?;
        let mut all = self.kept.borrow_mut();
        all.push(own);
        Ok(all.len() - 1)
    }

    fn forget(&self, pass: usize) {
        if let Some(units) = self.kept.borrow_mut().get_mut(pass) {
            units.clear();
        }
    }
}

/// Passes over shards in this process.
fn here<S: Shards>(shards: &S) -> impl Passes {
    Here { shards, kept: RefCell::default() }
}

fn memory(texels: usize, shards: usize, columns: usize) -> Memory {
    let all = shards * columns;
    let mut state = 3u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 40) as f32 / (1u32 << 24) as f32) - 0.5
    };
    let modes: Vec<f32> = (0..30 * all).map(|_| noise()).collect();
    let mut values = vec![0.0; texels * all];
    for row in values.chunks_exact_mut(all) {
        row.iter_mut().for_each(|v| *v = 0.4 + 0.02 * noise());
        for (k, mode) in modes.chunks_exact(all).enumerate() {
            let amount = noise() * 0.8f32.powi(k as i32);
            row.iter_mut().zip(mode).for_each(|(v, m)| *v += amount * m);
        }
    }
    Memory { values, shards, columns }
}

/// The energy that the rows of `basis` capture, and the total.
fn captured(memory: &Memory, basis: &[f64], mean: &[f64]) -> (f64, f64) {
    let (mut part, mut all) = (0.0, 0.0);
    for row in memory.values.chunks_exact(mean.len()) {
        let centred: Vec<f64> = row.iter().zip(mean).map(|(&v, m)| f64::from(v) - m).collect();
        all += centred.iter().map(|v| v * v).sum::<f64>();
        for b in basis.chunks_exact(mean.len()) {
            part += b.iter().zip(&centred).map(|(b, v)| b * v).sum::<f64>().powi(2);
        }
    }
    (part, all)
}

/// The squared error of mean, coefficients and basis.
fn left_out(memory: &Memory, found: &Global) -> f64 {
    let columns = found.mean.len();
    let count = found.basis.len() / columns;
    let rows = memory.values.chunks_exact(columns).zip(found.coefficients.chunks_exact(count));
    rows.map(|(row, coefficients)| {
        let value = |i: usize| -> f64 {
            let terms = coefficients.iter().zip(found.basis[i..].iter().step_by(columns));
            found.mean[i] + terms.map(|(c, b)| f64::from(*c) * b).sum::<f64>()
        };
        row.iter().enumerate().map(|(i, &v)| (f64::from(v) - value(i)).powi(2)).sum::<f64>()
    })
    .sum()
}

#[test]
fn components_are_those_of_the_scatter_matrix() {
    let memory = memory(3000, 4, 30);
    let columns = 120;
    let mut tile = FloatTile::new(columns);
    let whole = Memory { values: memory.values.clone(), shards: 1, columns };
    let fill = |tile: &mut FloatTile, first: usize, count: usize| whole.load(&0, tile, first, count, &[]);
    let exact = crate::factor::moments::moments_f32(3000, &mut tile, &fill);
    // thirty modes that decay, below the noise from the twentieth on, where the spectrum is flat
    for count in [1, 5, 12, 40] {
        let eigen = largest_eigenpairs(&exact.scatter, columns, count).unwrap();
        let (best, all) = captured(&memory, &eigen.vectors, &exact.mean);
        let found = principal_components(&here(&memory), count).unwrap().unwrap();
        check_components(&memory, &found, [best, all], 1e-4);
        for (k, value) in eigen.values.iter().enumerate() {
            let length: f64 = found.coefficients.iter().skip(k).step_by(count).map(|&c| f64::from(c).powi(2)).sum();
            assert!((length / value - 1.0).abs() < 1e-3, "{count}: component {k}: {length} {value}");
        }
        let rough = rough_components(&here(&memory), count).unwrap().unwrap();
        check_components(&memory, &rough, [best, all], if count == 40 { 0.03 } else { 2e-4 });
        for (a, b) in found.mean.iter().chain(&rough.mean).zip(exact.mean.iter().chain(&exact.mean)) {
            assert!((a - b).abs() < 1e-6, "{count}: {a} {b}");
        }
    }
}

/// Checks components against the energy `best` of the best ones, of `all`, and `missed` as a fraction of the rest.
fn check_components(memory: &Memory, found: &Global, [best, all]: [f64; 2], missed: f64) {
    let count = found.basis.len() / found.mean.len();
    let (got, _) = captured(memory, &found.basis, &found.mean);
    assert!((found.energy - all).abs() < 1e-4 * all, "{count}: {} {all}", found.energy);
    assert!(best - got <= missed * (all - best) + 1e-6 * all, "{count}: {best} {got} of {all}");
    let left = left_out(memory, found);
    assert!(left <= (1.0 + missed) * (all - best) + 1e-6 * all, "{count}: {left} of {}", all - best);
    // the coefficients of different components are orthogonal, the largest first
    let inner = |a: usize, b: usize| {
        let rows = found.coefficients.chunks_exact(count);
        rows.map(|row| f64::from(row[a]) * f64::from(row[b])).sum::<f64>()
    };
    for a in 0..count {
        assert!(a == 0 || inner(a, a) <= inner(a - 1, a - 1), "{count}: {a}");
        for b in 0..a {
            assert!(inner(a, b).abs() <= 1e-3 * (inner(a, a) * inner(b, b)).sqrt(), "{count}: {a} {b}");
        }
    }
}

#[test]
fn a_sketch_captures_nearly_as_much() {
    let memory = memory(3000, 4, 30);
    for (count, missed) in [(5, 1.05), (12, 1.05), (120, 1.0)] {
        let best = principal_components(&here(&memory), count).unwrap().unwrap();
        let found = sketched_components(&here(&memory), count).unwrap().unwrap();
        let [(best, all), (got, _)] = [best, found].map(|g| captured(&memory, &g.basis, &g.mean));
        assert!(all - got <= missed * (all - best) + 1e-6 * all, "{count}: {best} {got} of {all}");
    }
    assert_eq!(sketched_components(&here(&memory), 500).unwrap().unwrap().coefficients.len(), 3000 * 120);
}

#[test]
fn a_subsample_gives_the_same_components() {
    let (texels, columns) = (SUBSAMPLE * MIN_SUBSAMPLE, 30);
    let memory = memory(texels, 2, columns / 2);
    let mut tile = FloatTile::new(columns);
    let whole = Memory { values: memory.values.clone(), shards: 1, columns };
    let fill = |tile: &mut FloatTile, first: usize, count: usize| whole.load(&0, tile, first, count, &[]);
    let exact = crate::factor::moments::moments_f32(texels, &mut tile, &fill);
    // a quarter of the texels represents all for the first two
    for count in [1, 4, 9] {
        let eigen = largest_eigenpairs(&exact.scatter, columns, count).unwrap();
        let found = principal_components(&here(&memory), count).unwrap().unwrap();
        let (best, all) = captured(&memory, &eigen.vectors, &exact.mean);
        let left = left_out(&memory, &found);
        assert!(left <= (1.0 + rounds::TOLERANCE) * (all - best), "{count}: {left} of {}", all - best);
        assert!(left >= (1.0 - 1e-5) * (all - best), "{count}: {left} of {}", all - best);
        for (a, b) in found.mean.iter().zip(&exact.mean) {
            assert!((a - b).abs() < 1e-6, "{count}: {a} {b}");
        }
    }
}

#[test]
fn threads_change_nothing_and_all_dimensions_are_enough() {
    let memory = memory(700, 3, 9);
    let run = |threads: usize, count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| principal_components(&here(&memory), count)).unwrap().unwrap()
    };
    assert!(run(1, 4) == run(2, 4));
    let full = run(2, 27);
    let (got, all) = captured(&memory, &full.basis, &full.mean);
    assert!((all - got).abs() < 1e-5 * all, "{got} {all}");
}

#[test]
fn constants_have_no_components_and_nan_is_refused() {
    let mut memory = Memory { values: vec![0.5; 200 * 12], shards: 2, columns: 6 };
    let found = principal_components(&here(&memory), 3).unwrap().unwrap();
    assert!(found.coefficients.iter().all(|c| c.abs() < 1e-5));
    memory.values[77] = f32::NAN;
    assert!(principal_components(&here(&memory), 3).unwrap().is_none());
}
