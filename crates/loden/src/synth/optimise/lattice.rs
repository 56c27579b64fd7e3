//! Displacements at which a regular exemplar repeats itself.

use super::super::fft::{self, Complex, product};
use super::sample::{Sample, variance};

/// The largest difference between the exemplar and its displaced copy, as a share of that between unrelated texels.
const ALIKE: f64 = 0.6;

/// The most displacements.
const MOST: usize = 200;

/// The share of displacements that a lattice must explain.
const EXPLAINED: f64 = 0.6;

/// Two displacements, in texels: sums of their multiples leave a regular exemplar unchanged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lattice([[f64; 2]; 2]);

impl Lattice {
    /// The lattice of a regular exemplar, none if it is not regular. Texels have unit variance.
    pub(super) fn of<const C: usize>(sample: &Sample<C>) -> Option<Self> {
        if variance(&sample.texels, &sample.open) <= 0.0 {
            return None;
        }
        let map = Differences::new(sample);
        let reach = map.size.map(|side| side as i32 * 3 / 4);
        let alike = alike(&map, reach);
        let shortest = {
            let mut sorted = alike.clone();
            sorted.sort_by_key(|[x, y]| x * x + y * y);
            sorted.truncate(24);
            sorted
        };
        let range = 2.0 * f64::from(reach[0]) * f64::from(reach[1]);
        let mut best: (f64, Option<Self>) = (0.0, None);
        for (i, a) in shortest.iter().enumerate() {
            for b in &shortest[..i] {
                let Some(lattice) = Self([a.map(f64::from), b.map(f64::from)]).refined(&alike) else { continue };
                let explained = alike.iter().filter(|v| lattice.multiples(v.map(f64::from)).is_some()).count() as f64;
                let expected = range / lattice.area().max(1.0);
                let score = explained * explained / expected;
                if explained >= EXPLAINED * alike.len() as f64 && score > best.0 {
                    best = (score, Some(lattice));
                }
            }
        }
        best.1.map(|lattice| lattice.reduced())
    }

    fn area(&self) -> f64 {
        let [a, b] = self.0;
        (a[0] * b[1] - a[1] * b[0]).abs()
    }

    /// How many times each vector leads to a displacement, if nearly whole numbers do.
    fn multiples(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let [a, b] = self.0;
        let area = a[0] * b[1] - a[1] * b[0];
        let exact = [(x * b[1] - y * b[0]) / area, (a[0] * y - a[1] * x) / area];
        let whole = exact.map(f64::round);
        let [dx, dy] = self.displacement(whole[0], whole[1]);
        let shortest = a[0].hypot(a[1]).min(b[0].hypot(b[1]));
        let limit = (0.15 * shortest).max(1.0);
        (area.abs() >= 9.0 && (dx - x).hypot(dy - y) <= limit).then_some(whole)
    }

    /// The sum of these multiples.
    fn displacement(&self, m: f64, n: f64) -> [f64; 2] {
        let [a, b] = self.0;
        [m * a[0] + n * b[0], m * a[1] + n * b[1]]
    }

    /// A better fit to displacements, near ones first: the vectors are whole numbers at first, whose multiples miss.
    fn refined(self, to: &[[i32; 2]]) -> Option<Self> {
        let [a, b] = self.0;
        let longest = a[0].hypot(a[1]).max(b[0].hypot(b[1]));
        [2.2, 4.5, 9.0, f64::INFINITY].iter().try_fold(self, |lattice, reach| lattice.fitted(to, reach * longest))
    }

    /// The vectors that fit to the displacements up to a length by least squares.
    fn fitted(&self, to: &[[i32; 2]], reach: f64) -> Option<Self> {
        let (mut mm, mut mn, mut nn, mut right) = (0.0, 0.0, 0.0, [[0.0; 2]; 2]);
        for v in to {
            let v = v.map(f64::from);
            if v[0].hypot(v[1]) > reach {
                continue;
            }
            let Some([m, n]) = self.multiples(v) else { continue };
            (mm, mn, nn) = (mm + m * m, mn + m * n, nn + n * n);
            for c in 0..2 {
                right[0][c] += m * v[c];
                right[1][c] += n * v[c];
            }
        }
        let determinant = mm * nn - mn * mn;
        let solve = |c: usize| {
            [(nn * right[0][c] - mn * right[1][c]) / determinant, (mm * right[1][c] - mn * right[0][c]) / determinant]
        };
        let ([ax, bx], [ay, by]) = (solve(0), solve(1));
        let fitted = Self([[ax, ay], [bx, by]]);
        (fitted.area().is_finite() && fitted.area() >= 9.0).then_some(fitted)
    }

    /// The same lattice by its shortest vectors.
    fn reduced(&self) -> Self {
        let [mut a, mut b] = self.0;
        let square = |v: [f64; 2]| v[0] * v[0] + v[1] * v[1];
        loop {
            if square(a) > square(b) {
                std::mem::swap(&mut a, &mut b);
            }
            let times = ((a[0] * b[0] + a[1] * b[1]) / square(a)).round();
            if times == 0.0 {
                return Self([a, b]);
            }
            b = [b[0] - times * a[0], b[1] - times * a[1]];
        }
    }

    /// All points of the lattice, rounded, inside a rectangle of texels.
    pub(super) fn within(&self, [left, top]: [i32; 2], [right, bottom]: [i32; 2]) -> Vec<(i32, i32)> {
        let [a, b] = self.0;
        let area = a[0] * b[1] - a[1] * b[0];
        let corners =
            [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(x, y)| (f64::from(x), f64::from(y)));
        let ms = corners.map(|(x, y)| (x * b[1] - y * b[0]) / area);
        let ns = corners.map(|(x, y)| (a[0] * y - a[1] * x) / area);
        let span = |v: [f64; 4]| {
            let (low, high) = v.into_iter().fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
            low.floor() as i32..=high.ceil() as i32
        };
        let point = |m: i32, n: i32| {
            let [x, y] = self.displacement(m.into(), n.into());
            (x.round() as i32, y.round() as i32)
        };
        let inside = |(x, y): &(i32, i32)| (left..=right).contains(x) && (top..=bottom).contains(y);
        span(ms).flat_map(|m| span(ns).map(move |n| point(m, n))).filter(inside).collect()
    }
}

/// Displacements at which the exemplar resembles itself, the closest resemblance first; one of each opposite pair.
fn alike(map: &Differences, [w, h]: [i32; 2]) -> Vec<[i32; 2]> {
    let mut found: Vec<(f64, [i32; 2])> = Vec::new();
    for dy in 0..=h {
        for dx in -w..=w {
            if (dy == 0 && dx <= 0) || dx * dx + dy * dy < 9 {
                continue;
            }
            let value = map.at(dx, dy);
            let lowest = (-2..=2).all(|y| (-2..=2).all(|x| map.at(dx + x, dy + y) >= value));
            if value < ALIKE && lowest {
                found.push((value, [dx, dy]));
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let least = found.first().map_or(0.0, |first| first.0);
    let limit = least + 0.3 * (1.0 - least);
    found.into_iter().filter(|(value, _)| *value <= limit).take(MOST).map(|(_, v)| v).collect()
}

/// The largest side of the part of an exemplar that is compared with itself.
const PART: usize = 512;

/// Half of the mean squared difference of texels at each displacement; one for unrelated texels.
struct Differences {
    values: Vec<f64>,
    width: usize,
    /// Columns and rows of the part that is compared.
    size: [usize; 2],
}

impl Differences {
    /// Differences within the middle of the exemplar, by the transforms of its correlations.
    fn new<const C: usize>(sample: &Sample<C>) -> Self {
        let (full_w, full_h) = (sample.domain.width, sample.domain.height);
        let (w, h) = (full_w.min(PART), full_h.min(PART));
        let texel = |i: usize| (i / w + (full_h - h) / 2) * full_w + i % w + (full_w - w) / 2;
        let (padded_w, padded_h) = ((2 * w).next_power_of_two(), (2 * h).next_power_of_two());
        let spectrum = |value: &dyn Fn(&[f32; C]) -> f64| {
            let mut padded = vec![[0.0; 2]; padded_w * padded_h];
            for i in (0..w * h).filter(|i| sample.open[texel(*i)]) {
                padded[i / w * padded_w + i % w][0] = value(&sample.texels[texel(i)]);
            }
            fft::transform(&mut padded, padded_w);
            padded
        };
        let conjugate = |[re, im]: Complex| [re, -im];
        let ones = spectrum(&|_| 1.0);
        let squares = spectrum(&|texel| texel.iter().map(|v| f64::from(v * v)).sum());
        let mut overlap: Vec<Complex> = ones.iter().map(|v| product(*v, conjugate(*v))).collect();
        let mut energy: Vec<Complex> = ones.iter().zip(&squares).map(|(a, b)| product(conjugate(*a), *b)).collect();
        let mut products: Vec<Complex> = vec![[0.0; 2]; padded_w * padded_h];
        for c in 0..C {
            let channel = spectrum(&|texel| texel[c].into());
            products.iter_mut().zip(&channel).for_each(|(sum, v)| sum[0] += product(*v, conjugate(*v))[0]);
        }
        for spectrum in [&mut products, &mut overlap, &mut energy] {
            fft::inverse(spectrum, padded_w);
        }
        let value = |i: usize| {
            let opposite = (padded_h - i / padded_w) % padded_h * padded_w + (padded_w - i % padded_w) % padded_w;
            let count = overlap[i][0].round();
            let difference = energy[i][0] + energy[opposite][0] - 2.0 * products[i][0];
            if count < 1.0 { f64::INFINITY } else { difference / (2.0 * count) }
        };
        Self { values: (0..padded_w * padded_h).map(value).collect(), width: padded_w, size: [w, h] }
    }

    fn at(&self, dx: i32, dy: i32) -> f64 {
        let height = self.values.len() / self.width;
        let (x, y) = (dx.rem_euclid(self.width as i32) as usize, dy.rem_euclid(height as i32) as usize);
        self.values[y * self.width + x]
    }
}
