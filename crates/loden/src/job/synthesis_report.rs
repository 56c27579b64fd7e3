//! Methods of synthesis compared on one sample.

use std::f32::consts::PI;
use std::time::Instant;

use glam::Vec3;
use serde::Serialize;

use super::stored_picture;
use crate::Result;
use crate::btf::BtfSource;
use crate::color::Encoding;
use crate::direction::{Scheme, from_angles};
use crate::material::angles::{Angles, LightStencil};
use crate::params::Values;
use crate::picture::Picture;
use crate::progress::Progress;
use crate::synth::measure::{HeldOut, Measures, halves, seam_energy};
use crate::synth::{Exemplar, Goal, SourceMap, Synthesis, synthesize};

/// Pairs of directions at which results of BTFs are measured, some of them grazing: (light, view), polar angle and azimuth
/// in degrees.
const MEASURED: [([f32; 2], [f32; 2]); 8] = [
    ([15.0, 60.0], [0.0, 0.0]),
    ([45.0, 210.0], [0.0, 0.0]),
    ([45.0, 90.0], [30.0, 0.0]),
    ([60.0, 300.0], [45.0, 120.0]),
    ([30.0, 90.0], [60.0, 0.0]),
    ([60.0, 0.0], [60.0, 180.0]),
    ([45.0, 240.0], [75.0, 60.0]),
    ([75.0, 90.0], [75.0, 270.0]),
];

/// Frames of a light that moves half a circle around the sample, at this angle from the normal, seen from the front.
const FRAMES: usize = 20;
const FRAMES_DEGREES: f32 = 45.0;

/// Pairs that are shown, by their number above, with what they show.
const SHOWN: [(usize, &str); 3] = [(0, "light from above"), (1, "light from the left"), (4, "seen at 60 degrees")];

/// A sample on which methods are compared.
#[derive(Debug, Clone)]
pub struct SynthesisSample {
    /// What the methods compare texels by.
    pub exemplar: Exemplar,
    /// What results are measured by.
    pub measured: Exemplar,
    /// How texels of a BTF change from frame to frame while the light moves.
    pub changes: Option<Exemplar>,
    /// Pictures of the sample, with what they show.
    pub pictures: Vec<(&'static str, Picture)>,
}

/// What one method made of a sample.
#[derive(Debug, Clone, Serialize)]
pub struct SynthesisRow {
    /// The method.
    pub method: &'static str,
    /// Seconds for the result.
    pub seconds: f64,
    /// How good the result is.
    pub measures: Measures,
    /// A result of the left half of the sample, compared with the right half.
    pub held_out: HeldOut,
    /// Seam energy of the changes while the light moves: above 1, seams flicker more than neighbours in the sample.
    pub flicker: Option<f64>,
    /// The result.
    #[serde(skip)]
    pub map: SourceMap,
}

impl SynthesisSample {
    /// A BTF, compared by this many channels and measured by images of eight pairs of directions.
    ///
    /// # Errors
    /// As [`Exemplar::of_btf`].
    pub fn of_btf(source: &dyn BtfSource, channels: usize, progress: &dyn Progress) -> Result<Self> {
        let meta = source.meta();
        let direction = |[theta, phi]: [f32; 2]| from_angles(theta.to_radians(), phi.to_radians());
        let image = |(light, view): &([f32; 2], [f32; 2])| {
            let (view, light) = meta.nearest_pair(direction(*light), direction(*view));
            Ok(stored_picture(meta, &source.image(view, light)?.to_f32()))
        };
        let images = MEASURED.iter().map(image).collect::<Result<Vec<_>>>()?;
        // distances are means over the pairs
        let scale = 1.0 / (images.len() as f32).sqrt();
        let display = |texel: usize| images.iter().flat_map(move |image| image.rgb[texel].to_array());
        let value = |v: f32| Encoding::Srgb.encode(v.clamp(0.0, 1.0)) * scale;
        let values = (0..meta.texels()).flat_map(|texel| display(texel).map(value)).collect();
        Ok(Self {
            exemplar: Exemplar::of_btf(source, channels, progress)?,
            measured: Exemplar::new(meta.width, meta.height, 3 * images.len(), values),
            changes: Some(changes(source)?),
            pictures: SHOWN.iter().map(|(pair, name)| (*name, images[*pair].clone())).collect(),
        })
    }

    /// A picture, compared and measured by its display values.
    pub fn of_picture(picture: Picture) -> Self {
        let exemplar = Exemplar::of_picture(&picture);
        Self { measured: exemplar.clone(), exemplar, changes: None, pictures: vec![("the picture", picture)] }
    }

    /// Makes and measures a result, and another one of the left half of the sample.
    ///
    /// # Errors
    /// As [`synthesize`].
    pub fn row(
        &self,
        method: &dyn Synthesis,
        params: &Values,
        goal: &Goal,
        progress: &dyn Progress,
    ) -> Result<SynthesisRow> {
        let start = Instant::now();
        let map = synthesize(method, &self.exemplar, goal, params, progress)?;
        let seconds = start.elapsed().as_secs_f64();
        let [left, _] = halves(&self.exemplar);
        let half = Goal { width: left.width, height: left.height, ..goal.clone() };
        let held_out = HeldOut::new(&self.measured, &synthesize(method, &left, &half, params, progress)?);
        Ok(SynthesisRow {
            method: method.name(),
            seconds,
            measures: Measures::new(&self.measured, &map),
            held_out,
            flicker: self.changes.as_ref().map(|changes| seam_energy(changes, &map)),
            map,
        })
    }

    /// The pictures of a result: at most `side` texels wide and high, from its top left corner.
    pub fn pictures_of(&self, map: &SourceMap, side: usize) -> Vec<Picture> {
        let of = |(_, sample): &(&str, Picture)| cut(map, side, |x, y| sample.at(x, y));
        self.pictures.iter().map(of).collect()
    }

    /// The map as a picture: the column of a source is its red, the row its green.
    pub fn picture_of_map(&self, map: &SourceMap, side: usize) -> Picture {
        let (w, h) = (self.exemplar.width as f32, self.exemplar.height as f32);
        let display = |x: usize, y: usize| Vec3::new((x as f32 + 0.5) / w, (y as f32 + 0.5) / h, 0.5);
        cut(map, side, |x, y| Vec3::from_array(display(x, y).to_array().map(|v| Encoding::Srgb.decode(v))))
    }
}

/// The changes of display values from frame to frame while the light moves.
fn changes(source: &dyn BtfSource) -> Result<Exemplar> {
    let meta = source.meta();
    let angles = Angles::new(meta, Scheme::Triangles)?;
    let front = angles.views_around(Vec3::Z);
    let view = meta.views.nearest(Vec3::Z);
    let frame = |k: usize| {
        let phi = PI * k as f32 / (FRAMES - 1) as f32;
        let mut image = vec![0.0; meta.image_len()];
        let mut around = LightStencil::NONE;
        angles.lit(&front, from_angles(FRAMES_DEGREES.to_radians(), phi), Vec3::Z, &mut around);
        for (light, weight) in around.lights.iter() {
            let stored = source.image(view, light)?;
            let values = stored_picture(meta, &stored.to_f32()).rgb;
            let display = values.iter().flat_map(|c| c.to_array().map(|v| Encoding::Srgb.encode(v.clamp(0.0, 1.0))));
            image.iter_mut().zip(display).for_each(|(sum, v)| *sum += weight * v);
        }
        Ok(image)
    };
    let frames = (0..FRAMES).map(frame).collect::<Result<Vec<Vec<f32>>>>()?;
    // rounding is no change
    let seen = |change: f32| if change.abs() < 1e-5 { 0.0 } else { change };
    let change = |texel: usize| {
        let of = move |k: usize| (0..3).map(move |c| (k, 3 * texel + c));
        (1..FRAMES).flat_map(of).map(|(k, at)| frames[k][at] - frames[k - 1][at]).map(seen).collect::<Vec<f32>>()
    };
    let values = (0..meta.texels()).flat_map(change).collect();
    Ok(Exemplar::new(meta.width, meta.height, 3 * (FRAMES - 1), values))
}

/// The top left corner of a result whose texels have these colours in the sample.
fn cut(map: &SourceMap, side: usize, color: impl Fn(usize, usize) -> Vec3) -> Picture {
    let (width, height) = (map.width.min(side), map.height.min(side));
    let pixel = |i: usize| {
        let source = map.at(i % width, i / width);
        color(source.x.into(), source.y.into())
    };
    Picture { width, height, rgb: (0..width * height).map(pixel).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::btf::{BtfMeta, Cosine, MemoryBtf, SampleType, Texels};
    use crate::direction::DirectionSet;
    use crate::progress::Silent;
    use crate::random::{mix, unit};
    use crate::synth::by_name;

    #[test]
    fn results_are_measured_by_grazing_images_too_and_shown_as_copies() {
        let (views, lights) = (DirectionSet::bonn81(), DirectionSet::bonn81());
        let (encoding, cosine, sample_type) = (Encoding::Srgb, Cosine::Included, SampleType::U8);
        let meta = BtfMeta { width: 24, height: 20, views, lights, encoding, cosine, sample_type };
        let value = |i: usize| (unit(mix((i % meta.image_len()) as u64)) * 200.0) as u8;
        let texels: Vec<u8> = (0..meta.pairs() * meta.image_len()).map(value).collect();
        let btf = MemoryBtf::new(meta, Texels::U8(texels.into())).unwrap();
        let sample = SynthesisSample::of_btf(&btf, 8, &Silent).unwrap();
        assert_eq!((sample.measured.channels, sample.pictures.len()), (24, 3));
        let method = by_name("tiling").unwrap();
        let goal = Goal::new(48, 20);
        let row = sample.row(method, &Values::defaults(method.params()), &goal, &Silent).unwrap();
        // the only patches that the sample does not have lie across the edges of tiles
        assert!(row.measures.patch_distance[0] < 0.05, "{:?}", row.measures);
        assert!(row.measures.seam_energy > 0.0 && row.held_out.result[0] > 0.0);
        // nothing changes with the light
        assert_eq!(row.flicker, Some(0.0));
        let pictures = sample.pictures_of(&row.map, 30);
        assert_eq!((pictures[0].width, pictures[0].height), (30, 20));
        assert_eq!(pictures[2].at(25, 3), sample.pictures[2].1.at(1, 3));
        assert!(sample.picture_of_map(&row.map, 30).at(23, 0).x > 0.9);
    }
}
