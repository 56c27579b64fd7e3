//! A material evaluated through a map.

use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::{Source, SourceMap};
use crate::Result;
use crate::material::angles::{Footprint, texel_centre};
use crate::material::{Bounce, Material, Point, Prepared, Sample};

/// A material whose texels are rearranged.
pub struct Mapped {
    pub sample: Arc<dyn Material>,
    /// Texels of the sample along u and v.
    pub size: [usize; 2],
    pub map: Arc<SourceMap>,
}

/// Where the sample is evaluated for a texture coordinate: one place, or at a seam four texels with weights.
#[derive(Clone, Copy)]
struct Place {
    uv: [Vec2; 4],
    weight: [f32; 4],
    /// Used entries, 1 or 4.
    count: usize,
    /// The entry with the largest weight.
    nearest: usize,
}

impl Place {
    fn one(uv: Vec2) -> Self {
        Self { uv: [uv; 4], weight: [1.0, 0.0, 0.0, 0.0], count: 1, nearest: 0 }
    }

    fn parts(&self) -> impl Iterator<Item = (Vec2, f32)> {
        self.uv.into_iter().zip(self.weight).take(self.count)
    }
}

impl Mapped {
    fn place(&self, uv: Vec2) -> Place {
        let [width, height] = self.size;
        let footprint = Footprint::new(uv, self.map.width, self.map.height);
        let sources = footprint.texel.map(|texel| self.map.sources[texel]);
        let centre = |source: Source| texel_centre(source.texel(width), width, height);
        if footprint.is_texel() {
            return Place::one(centre(sources[0]));
        }
        let (x, y) = (usize::from(sources[0].x), usize::from(sources[0].y));
        let (x1, y1) = ((x + 1) % width, (y + 1) % height);
        if sources[1..] == [Source::new(x1, y), Source::new(x, y1), Source::new(x1, y1)] {
            let [_, right, below, both] = footprint.weight;
            let step = Vec2::new((right + both) / width as f32, -(below + both) / height as f32);
            return Place::one(centre(sources[0]) + step);
        }
        let weight = footprint.weight;
        let nearest = (1..4).fold(0, |best, k| if weight[k] > weight[best] { k } else { best });
        Place { uv: sources.map(centre), weight, count: 4, nearest }
    }

    fn value(&self, place: &Place, wi: Vec3, wo: Vec3) -> Vec3 {
        place.parts().map(|(uv, weight)| weight * self.sample.apparent(uv, wi, wo)).sum()
    }
}

impl Material for Mapped {
    fn apparent(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> Vec3 {
        self.value(&self.place(uv), wi, wo)
    }

    fn texels(&self) -> Option<[usize; 2]> {
        Some([self.map.width, self.map.height])
    }

    fn sample(&self, uv: Vec2, wo: Vec3, random: Vec2) -> Option<Sample> {
        let place = self.place(uv);
        self.sample.sample(place.uv[place.nearest], wo, random)
    }

    fn pdf(&self, uv: Vec2, wi: Vec3, wo: Vec3) -> f32 {
        let place = self.place(uv);
        self.sample.pdf(place.uv[place.nearest], wi, wo)
    }

    fn prepare<'a>(&'a self, points: &'a [Point]) -> Box<dyn Prepared + 'a> {
        Box::new(MappedPoints { material: self, points, places: points.iter().map(|p| self.place(p.uv)).collect() })
    }

    fn check(&self) -> Result<()> {
        self.sample.check()
    }
}

/// Points with their places in the sample.
struct MappedPoints<'a> {
    material: &'a Mapped,
    points: &'a [Point],
    places: Vec<Place>,
}

impl MappedPoints<'_> {
    /// The points of the sample that directions are drawn at, and their indices.
    fn nearest(&self, index: &[u32]) -> (Vec<Point>, Vec<u32>) {
        let point = |&index: &u32| {
            let place = &self.places[index as usize];
            Point { uv: place.uv[place.nearest], wo: self.points[index as usize].wo }
        };
        (index.iter().map(point).collect(), (0..index.len() as u32).collect())
    }
}

impl Prepared for MappedPoints<'_> {
    fn apparent(&self, index: &[u32], wi: &[Vec3], values: &mut [Vec3]) {
        let each = || index.iter().zip(wi).map(|(&index, &wi)| (&self.places[index as usize], index, wi));
        let point = |(place, index, wi): (&Place, u32, Vec3)| {
            let wo = self.points[index as usize].wo;
            place.parts().map(|(uv, _)| (Point { uv, wo }, wi)).collect::<Vec<_>>()
        };
        let (points, wi): (Vec<Point>, Vec<Vec3>) = each().flat_map(point).unzip();
        let mut found = vec![Vec3::ZERO; points.len()];
        let all: Vec<u32> = (0..points.len() as u32).collect();
        self.material.sample.prepare(&points).apparent(&all, &wi, &mut found);
        let mut found = found.into_iter();
        for (value, (place, ..)) in values.iter_mut().zip(each()) {
            *value = place.parts().zip(&mut found).map(|((_, weight), value)| weight * value).sum();
        }
    }

    fn scatter(&self, index: &[u32], random: &[Vec2], bounces: &mut [Bounce]) {
        let (points, all) = self.nearest(index);
        self.material.sample.prepare(&points).scatter(&all, random, bounces);
        for (bounce, &index) in bounces.iter_mut().zip(index) {
            let place = &self.places[index as usize];
            if place.count > 1 && bounce.pdf > 0.0 {
                bounce.value = self.material.value(place, bounce.wi, self.points[index as usize].wo);
            }
        }
    }

    fn pdf(&self, index: &[u32], wi: &[Vec3], densities: &mut [f32]) {
        let (points, all) = self.nearest(index);
        self.material.sample.prepare(&points).pdf(&all, wi, densities);
    }
}
