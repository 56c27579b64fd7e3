//! Measures how well scattered samples predict those that are left out, a fifth at a time.
//!
//! Usage: `scattered_error FILE...`, where files hold scattered samples (Cornell, ASTM, CUReT). All materials of a CUReT
//! file are taken together. Prints a Markdown table: the mean absolute difference over the mean, the root mean square
//! difference of cube roots of f cos relative to that of black, and the mean of the relative differences; by the nearest
//! sample and by [`Scattered`].

use glam::Vec3;
use loden::import::{self, Measured};
use loden::material::{BrdfSample, Scattered, Table};
use loden::params::Given;

const FOLDS: usize = 5;

/// Sums over samples and channels.
#[derive(Default)]
struct Sums {
    difference: f64,
    value: f64,
    roots: f64,
    black: f64,
    relative: f64,
    count: f64,
}

impl Sums {
    fn add(&mut self, sample: &BrdfSample, found: Vec3, noise: f32) {
        for c in 0..3 {
            let (a, b) = (f64::from(sample.value[c]), f64::from(found[c]));
            let root = |v: f64| (v * f64::from(sample.wi.z)).cbrt();
            self.difference += (a - b).abs();
            self.value += a;
            self.roots += (root(a) - root(b)).powi(2);
            self.black += root(a).powi(2);
            self.relative += (a - b).abs() / (a + f64::from(noise));
            self.count += 1.0;
        }
    }

    fn cells(&self) -> String {
        let roots = (self.roots / self.black).sqrt();
        format!("{:.3} | {:.3} | {:.3}", self.difference / self.value, roots, self.relative / self.count)
    }
}

/// Adds the errors at samples that are left out, by the nearest sample and by interpolation.
fn held_out(samples: &[BrdfSample], sums: &mut [Sums; 2]) -> loden::Result<()> {
    // scattered parts of equal size
    let part = |i: usize| ((i as f64 * 0.618_033_988_749_895).fract() * FOLDS as f64) as usize;
    let mut values: Vec<f32> = samples.iter().map(|s| s.value.element_sum() / 3.0).collect();
    values.sort_by(f32::total_cmp);
    let noise = 0.1 * values[values.len() / 2];
    for fold in 0..FOLDS {
        let kept: Vec<BrdfSample> = (0..samples.len()).filter(|i| part(*i) != fold).map(|i| samples[i]).collect();
        let table = Scattered::new(kept.clone())?;
        for (_, sample) in samples.iter().enumerate().filter(|(i, _)| part(*i) == fold) {
            sums[0].add(sample, nearest(&kept, sample), noise);
            sums[1].add(sample, table.value(sample.wi, sample.wo), noise);
        }
    }
    Ok(())
}

/// The value of the sample nearest by half and difference angles and by the cosines.
fn nearest(kept: &[BrdfSample], at: &BrdfSample) -> Vec3 {
    let place = |s: &BrdfSample| {
        let half = (s.wi + s.wo).normalize();
        let [h, d] =
            [half.z, s.wi.dot(half)].map(|cosine| cosine.clamp(-1.0, 1.0).acos() / std::f32::consts::FRAC_PI_2);
        Vec3::new(h.sqrt(), d, 2.0 * (s.wi.z - s.wo.z).abs())
    };
    let here = place(at);
    let distance = |s: &BrdfSample| place(s).distance_squared(here);
    kept.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).map_or(Vec3::ZERO, |s| s.value)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("| material | nearest: mean | cube root | relative | interpolated: mean | cube root | relative |");
    println!("|---|---|---|---|---|---|---|");
    for path in std::env::args().skip(1) {
        let mut sums = [Sums::default(), Sums::default()];
        let mut held = 0;
        for index in 1.. {
            let several = path.ends_with(".dat");
            let options = if several { Given::default().with("index", index.to_string()) } else { Given::default() };
            let Ok((_, Measured::Brdf(brdf))) = import::open_named(&path, &options) else { break };
            held_out(&brdf.samples(), &mut sums)?;
            held += 1;
            if !several {
                break;
            }
        }
        let stem = std::path::Path::new(&path).file_stem().map_or(path.clone(), |s| s.to_string_lossy().into_owned());
        println!("| {stem} ({held}) | {} | {} |", sums[0].cells(), sums[1].cells());
    }
    Ok(())
}
