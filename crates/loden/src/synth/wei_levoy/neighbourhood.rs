//! Neighbourhoods as vectors: texels before one, or around it, on its level, and those around it on the coarser level.

use crate::synth::{Exemplar, Source, SourceMap};

/// The values of a level of the result, which continues at its opposite edges.
pub struct Image {
    width: usize,
    height: usize,
    channels: usize,
    values: Vec<f32>,
}

impl Image {
    pub fn texel_mut(&mut self, x: usize, y: usize) -> &mut [f32] {
        &mut self.values[(y * self.width + x) * self.channels..][..self.channels]
    }

    /// The texel at a distance from another.
    fn near(&self, at: (usize, usize), (dx, dy): (isize, isize)) -> &[f32] {
        let x = (at.0 as isize + dx).rem_euclid(self.width as isize) as usize;
        let y = (at.1 as isize + dy).rem_euclid(self.height as isize) as usize;
        &self.values[(y * self.width + x) * self.channels..][..self.channels]
    }
}

impl Exemplar {
    /// The values that a map copies.
    pub fn rearranged(&self, map: &SourceMap) -> Image {
        let values = map.sources.iter().flat_map(|source| self.texel(source.x.into(), source.y.into()));
        Image { width: map.width, height: map.height, channels: self.channels, values: values.copied().collect() }
    }
}

/// The texels of a neighbourhood on two levels of the exemplar.
pub struct Neighbourhood<'a> {
    sample: &'a Exemplar,
    coarser: Option<&'a Exemplar>,
    own: Vec<(isize, isize)>,
    around: Vec<(isize, isize)>,
}

/// The largest distance to a texel of a neighbourhood along a side of the exemplar: most positions must lie inside.
fn reach(radius: usize, side: usize, periodic: bool) -> isize {
    if periodic { radius as isize } else { radius.min((side - 1) / 4) as isize }
}

impl<'a> Neighbourhood<'a> {
    /// With texels up to `radius` away on this level, those before the texel or all, and up to half of that away on the
    /// coarser level, if there is one.
    pub fn new(radius: usize, sample: &'a Exemplar, coarser: Option<&'a Exemplar>, all: bool) -> Self {
        let square = |radius: usize, level: &Exemplar| {
            let (x, y) = (reach(radius, level.width, level.periodic), reach(radius, level.height, level.periodic));
            (-y..=y).flat_map(move |dy| (-x..=x).map(move |dx| (dx, dy)))
        };
        let is_before = |&(dx, dy): &(isize, isize)| dy < 0 || dy == 0 && dx < 0;
        let own = square(radius, sample).filter(|step| *step != (0, 0) && (all || is_before(step))).collect();
        let around = coarser.map_or(vec![], |coarser| square(radius.div_ceil(2), coarser).collect());
        Self { sample, coarser, own, around }
    }

    /// Numbers of a vector; one that is always 0 for a neighbourhood without texels.
    pub fn dimensions(&self) -> usize {
        (self.sample.channels * (self.own.len() + self.around.len())).max(1)
    }

    /// The texels of the exemplar whose neighbourhood lies inside and is usable; all usable ones if there is none.
    pub fn candidates(&self) -> Vec<Source> {
        let all = (0..self.sample.height).flat_map(|y| (0..self.sample.width).map(move |x| (x, y)));
        let usable = all.filter(|&(x, y)| self.sample.is_usable(x, y));
        let inside = |level: &Exemplar, at: (usize, usize), near: &[(isize, isize)]| {
            near.iter().all(|&step| place(level, at, step).is_some_and(|(x, y)| level.is_usable(x, y)))
        };
        let whole = |&(x, y): &(usize, usize)| {
            inside(self.sample, (x, y), &self.own)
                && self.coarser.is_none_or(|coarser| inside(coarser, (x / 2, y / 2), &self.around))
        };
        let source = |(x, y)| Source::new(x, y);
        let found: Vec<Source> = usable.clone().filter(whole).map(source).collect();
        if found.is_empty() { usable.map(source).collect() } else { found }
    }

    /// The vectors of candidates, one after the other.
    pub fn vectors(&self, candidates: &[Source]) -> Vec<f32> {
        let mut vectors = Vec::with_capacity(candidates.len() * self.dimensions());
        for source in candidates {
            let (x, y) = (usize::from(source.x), usize::from(source.y));
            let first = vectors.len();
            let mut add = |level: &Exemplar, at: (usize, usize), near: &[(isize, isize)]| {
                for &step in near {
                    let (x, y) = place(level, at, step).unwrap_or(at);
                    vectors.extend_from_slice(level.texel(x, y));
                }
            };
            add(self.sample, (x, y), &self.own);
            if let Some(coarser) = self.coarser {
                add(coarser, (x / 2, y / 2), &self.around);
            }
            vectors.resize(first + self.dimensions(), 0.0);
        }
        vectors
    }

    /// The vector of a texel of the result.
    pub fn gather(&self, image: &Image, coarser: Option<&Image>, at: (usize, usize)) -> Vec<f32> {
        let mut vector = Vec::with_capacity(self.dimensions());
        self.own.iter().for_each(|&step| vector.extend_from_slice(image.near(at, step)));
        if let Some(coarser) = coarser {
            let at = (at.0 / 2, at.1 / 2);
            self.around.iter().for_each(|&step| vector.extend_from_slice(coarser.near(at, step)));
        }
        vector.resize(self.dimensions(), 0.0);
        vector
    }
}

/// The texel at a distance from another; `None` outside.
fn place(level: &Exemplar, at: (usize, usize), (dx, dy): (isize, isize)) -> Option<(usize, usize)> {
    let along = |at: usize, step: isize, side: usize| {
        let place = at as isize + step;
        if level.periodic {
            Some(place.rem_euclid(side as isize) as usize)
        } else {
            usize::try_from(place).ok().filter(|place| *place < side)
        }
    };
    Some((along(at.0, dx, level.width)?, along(at.1, dy, level.height)?))
}
