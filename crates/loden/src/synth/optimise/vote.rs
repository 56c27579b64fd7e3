//! Which texel of the exemplar a texel of the result copies, chosen by all neighbourhoods around it.

use rayon::prelude::*;

use super::super::Source;
use super::canvas::{Canvas, place};
use super::level::{Level, RADIUS};
use super::search::Matches;

/// What a distance is compared with: neighbourhoods that match better than this all count alike.
const GOOD: f32 = 0.3;

/// What it costs to disagree with every neighbourhood, as a squared distance of texels with unit variance.
const AGREEMENT: f32 = 0.05;

/// The most votes for a texel.
const VOTES: usize = (2 * RADIUS + 1) * (2 * RADIUS + 1);

/// Lets all matches vote. The winner is the offer nearest to the mean of all offers: a copy, never a mixture.
pub(super) fn vote<const C: usize>(
    level: &Level<C>,
    canvas: &Canvas<C>,
    matches: &Matches,
    typical: f32,
) -> Vec<Source> {
    let uniform = canvas.coherent(&matches.sources, level);
    let falloff = falloff(level.radius);
    let w = canvas.width;
    let mut sources = matches.sources.clone();
    sources.par_chunks_mut(w).enumerate().for_each(|(y, row)| {
        for (x, out) in row.iter_mut().enumerate() {
            if !uniform[y * w + x] {
                *out = elected(level, canvas, matches, (&falloff, GOOD * typical + 1e-6), x as i32, y as i32);
            }
        }
    });
    sources
}

/// Weights of votes by their distance.
fn falloff(radius: usize) -> Vec<f32> {
    let (r, sigma) = (radius as i32, 0.65 * radius.max(1) as f64);
    let weight = |x: i32, y: i32| libm::exp(-f64::from(x * x + y * y) / (2.0 * sigma * sigma)) as f32;
    (-r..=r).flat_map(|y| (-r..=r).map(move |x| weight(x, y))).collect()
}

fn elected<const C: usize>(
    level: &Level<C>,
    canvas: &Canvas<C>,
    matches: &Matches,
    (falloff, good): (&[f32], f32),
    x: i32,
    y: i32,
) -> Source {
    let (r, step) = (level.radius as i32, level.step as i32);
    let (w, h) = (canvas.width as i32, canvas.height as i32);
    // Collect different offers and their weights
    let mut offers = [(Source::default(), 0.0f32); VOTES];
    let mut count = 0;
    let mut total = 0.0;
    let mut mean = [0.0; C];
    for (k, falloff) in falloff.iter().enumerate() {
        let (dx, dy) = (k as i32 % (2 * r + 1) - r, k as i32 / (2 * r + 1) - r);
        let (nx, ny) = place(x + dx, y + dy, w, h, canvas.wraps);
        if !canvas.wraps && (nx, ny) != (x + dx, y + dy) {
            continue;
        }
        let voter = (ny * w + nx) as usize;
        let Some(source) = level.domain.shifted(matches.sources[voter], -dx * step, -dy * step, 0) else { continue };
        let weight = falloff / (good + matches.costs[voter]);
        total += weight;
        let texel = &level.texels[level.domain.index(source)];
        mean.iter_mut().zip(texel).for_each(|(sum, v)| *sum += weight * v);
        match offers[..count].iter_mut().find(|offer| offer.0 == source) {
            Some(offer) => offer.1 += weight,
            None => {
                offers[count] = (source, weight);
                count += 1;
            }
        }
    }
    // Choose the one nearest to their mean, with regard to how many agree
    let mut best = (f32::INFINITY, matches.sources[(y * w + x) as usize]);
    for (source, weight) in &offers[..count] {
        let texel = &level.texels[level.domain.index(*source)];
        let distance: f32 = mean.iter().zip(texel).map(|(sum, v)| (sum / total - v) * (sum / total - v)).sum();
        let cost = distance + AGREEMENT * (1.0 - weight / total);
        if cost < best.0 {
            best = (cost, *source);
        }
    }
    best.1
}
