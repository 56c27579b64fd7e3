//! A synthesis that is watched while it runs.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use glam::Vec3;
use loden::Result;
use loden::btf::BtfSource;
use loden::direction::from_angles;
use loden::job;
use loden::picture::Picture;
use loden::progress::Progress;

use crate::images::encoded;
use crate::jobs::Job;

/// Between two pictures.
const PAUSE: Duration = Duration::from_millis(400);

/// Pixels per side of a picture, at most.
const SIDE: usize = 512;

/// Where nothing is known yet: linear grey.
const UNKNOWN: Vec3 = Vec3::splat(0.0232);

/// Polar angle and azimuth of the light of pictures in degrees, as on the page; the view is from the front.
const LIGHT: [f32; 2] = [45.0, 120.0];

/// An image of a material from the front, lit from the side, as the page shows what is made of it.
pub(crate) fn frontal(source: &dyn BtfSource) -> Result<Picture> {
    let [theta, phi] = LIGHT.map(f32::to_radians);
    let (view, light) = source.meta().nearest_pair(from_angles(theta, phi), Vec3::Z);
    Ok(job::stored_picture(source.meta(), &source.image(view, light)?.to_f32()))
}

/// Shows a synthesis on its job.
pub(super) struct Watched<'a> {
    job: &'a Job,
    sample: Picture,
    last: Mutex<Option<Instant>>,
}

impl<'a> Watched<'a> {
    /// For a sample that looks like this.
    pub fn new(job: &'a Job, sample: Picture) -> Self {
        Self { job, sample, last: Mutex::default() }
    }

    /// The unfinished result, at most [`SIDE`] pixels wide and high.
    fn drawn(&self, [width, height]: [usize; 2], source: &dyn Fn(usize, usize) -> Option<[u16; 2]>) -> Picture {
        let step = width.max(height).div_ceil(SIDE).max(1);
        let (columns, rows) = (width.div_ceil(step), height.div_ceil(step));
        let color = |[x, y]: [u16; 2]| {
            let (x, y) = (usize::from(x).min(self.sample.width - 1), usize::from(y).min(self.sample.height - 1));
            self.sample.at(x, y)
        };
        let pixel = |i: usize| source(i % columns * step, i / columns * step).map_or(UNKNOWN, color);
        Picture { width: columns, height: rows, rgb: (0..columns * rows).map(pixel).collect() }
    }
}

impl Progress for Watched<'_> {
    fn begin(&self, name: &str, total: u64) {
        self.job.begin(name, total);
    }

    fn advance(&self, steps: u64) {
        self.job.advance(steps);
    }

    fn step(&self, text: &str) {
        self.job.step(text);
    }

    fn end(&self) {
        self.job.end();
    }

    fn stage(&self, text: &str) {
        self.job.stage(text);
    }

    fn warn(&self, text: &str) {
        self.job.warn(text);
    }

    fn unfinished(&self, width: usize, height: usize, source: &dyn Fn(usize, usize) -> Option<[u16; 2]>) {
        // others that come meanwhile are not drawn
        let Ok(mut last) = self.last.try_lock() else { return };
        if last.is_some_and(|last| last.elapsed() < PAUSE) {
            return;
        }
        if let Ok(png) = encoded(&self.drawn([width, height], source)) {
            self.job.show(png);
        }
        *last = Some(Instant::now());
    }

    fn command(&self) -> Option<&str> {
        self.job.command()
    }

    fn is_cancelled(&self) -> bool {
        self.job.is_cancelled()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::Job;

    #[test]
    fn what_is_known_is_copied_from_the_sample_and_large_results_are_thinned() {
        let job = Job::idle();
        let rgb = (0..6).map(|i| Vec3::splat(i as f32)).collect();
        let watched = Watched::new(&job, Picture { width: 3, height: 2, rgb });
        let known = |x: usize, y: usize| (y == 0).then_some([x as u16, 1]);
        let picture = watched.drawn([3, 2], &known);
        assert_eq!(picture.rgb[..3], [3.0, 4.0, 5.0].map(Vec3::splat));
        assert_eq!(picture.rgb[3..], [UNKNOWN; 3]);
        let picture = watched.drawn([1400, 700], &|x, _| Some([(x % 3) as u16, 0]));
        assert_eq!((picture.width, picture.height, picture.at(1, 0)), (467, 234, Vec3::ZERO));
        watched.unfinished(3, 2, &known);
        watched.unfinished(3, 2, &known);
        assert_eq!(job.shown(), 1, "the second one comes too early");
    }
}
