//! Larger materials and pictures from files.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use serde::Serialize;

use super::synthesize_joined::Joined;
use super::{open, stored_picture};
use crate::btf::BtfSource;
use crate::codec::{self, CompressedBtf, Finish, Goal as CompressionGoal, Rearranged, Source, SourceMap};
use crate::color::{Encoding, luminance};
use crate::direction::from_angles;
use crate::import::Measured;
use crate::material::{Interpolation, Material};
use crate::params::{Given, Values};
use crate::picture::Picture;
use crate::progress::Progress;
use crate::synth::{self, Endless, Exemplar, Goal, Guide, Relief, Synthesis, map};
use crate::{Error, Result};

crate::words! {
    /// What the file of a larger material holds.
    #[derive(Serialize)]
    #[serde(rename_all = "lowercase")]
    pub enum Store {
        /// The planes of the sample, and the map of sources: two numbers per texel, packed.
        Map = "map",
        /// Rearranged planes.
        Planes = "planes",
    }
}

crate::words! {
    /// What the texels of a material are compared by.
    #[derive(Serialize)]
    #[serde(rename_all = "lowercase")]
    pub enum Features {
        /// Principal components of its images.
        Appearance = "appearance",
        /// Height and slopes from its shading.
        Height = "height",
        /// Both, with equal weight.
        Both = "both",
    }
}

/// What is made larger.
#[derive(Debug, Clone)]
pub enum Sample {
    /// A BTF, compressed or not, named as for [`open()`], with the options of its importer.
    Material(PathBuf, Given),
    /// A picture.
    Picture(PathBuf),
}

/// Settings of a synthesis.
pub struct SynthesisRequest {
    /// What is made larger.
    pub sample: Sample,
    /// More samples of a material, with how often they are used relative to the first.
    pub with: Vec<(PathBuf, f32)>,
    /// The method.
    pub method: &'static dyn Synthesis,
    /// Its parameters.
    pub params: Values,
    /// Texels per row and rows of the result; those of the sample, whose masked texels are filled, if there is no size.
    pub size: Option<[usize; 2]>,
    /// Whether the result continues at its opposite edges.
    pub tileable: bool,
    /// Chooses one of many results.
    pub seed: u64,
    /// A picture of the size of the sample, bright where its texels may be copied.
    pub mask: Option<PathBuf>,
    /// A picture of the size of the result whose lightness it follows, and with what weight.
    pub guide: Option<(PathBuf, f32)>,
    /// Whether the sample continues at its opposite edges.
    pub periodic: bool,
    /// What the texels of a material are compared by.
    pub features: Features,
    /// The number of principal components.
    pub channels: usize,
    /// What the file of a material holds.
    pub store: Store,
    /// A file for the map of sources.
    pub map: Option<PathBuf>,
    /// The file to write: a `.loden` file, or a picture.
    pub output: PathBuf,
}

/// A larger material or picture.
#[derive(Debug, Clone, Serialize)]
pub struct Synthesized {
    /// The file.
    pub output: PathBuf,
    /// The sample.
    pub source: PathBuf,
    /// The method.
    pub method: &'static str,
    /// Its parameters.
    pub params: Values,
    /// Texels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Whether the result continues at its opposite edges.
    pub tileable: bool,
    /// The seed.
    pub seed: u64,
    /// What the file holds; none for a picture.
    pub store: Option<Store>,
    /// Size of the file.
    pub bytes: u64,
    /// Ratio of that to the size of the compressed sample; none for a picture.
    pub growth: Option<f64>,
    /// Seconds for the map.
    pub synthesis_s: f64,
    /// Seconds in all.
    pub seconds: f64,
    /// The file of the map.
    pub map: Option<PathBuf>,
}

/// Makes a larger material or picture. A BTF that is not compressed is compressed first, by the default method.
///
/// # Errors
/// Errors of opening, compressing and writing; [`Error::Unsupported`] for a BRDF; see also [`synth::synthesize`].
pub fn synthesize(request: &SynthesisRequest, progress: &dyn Progress) -> Result<Synthesized> {
    let start = Instant::now();
    let (made, store, growth) = match &request.sample {
        Sample::Picture(path) => (request.picture(path, progress)?, None, None),
        Sample::Material(path, options) => {
            let (made, growth) = request.material(path, options, progress)?;
            (made, Some(request.store), Some(growth))
        }
    };
    let (Sample::Picture(source) | Sample::Material(source, _)) = &request.sample;
    let output = &request.output;
    Ok(Synthesized {
        output: output.clone(),
        source: source.clone(),
        method: request.method.name(),
        params: request.params.clone(),
        width: made.width,
        height: made.height,
        tileable: request.tileable,
        seed: request.seed,
        store,
        bytes: std::fs::metadata(output).map_err(Error::io(output))?.len(),
        growth,
        synthesis_s: made.seconds,
        seconds: start.elapsed().as_secs_f64(),
        map: request.map.clone(),
    })
}

/// Rearranges a picture by the map in a file, as [`map::apply`].
///
/// # Errors
/// Errors of reading the map, and as [`map::apply`].
pub fn apply_map(sources: &Path, picture: &Path, output: &Path) -> Result<()> {
    map::apply(&map::read_map(sources)?, picture, output)
}

/// The material of a BTF that goes on without end; a warning says if its structure is lost.
pub(super) fn endless(
    measured: Measured,
    path: &Path,
    interpolation: Interpolation,
    progress: &dyn Progress,
) -> Result<Arc<dyn Material>> {
    let source: Arc<dyn BtfSource> = match &measured {
        Measured::Btf(source) => source.clone(),
        Measured::Compressed(compressed) => compressed.clone(),
        Measured::Brdf(_) => return Err(Error::unsupported(path, "holds a BRDF, which has no texels to go on with")),
    };
    let sample = measured.material(interpolation)?;
    let endless = Endless::new(&*source, sample, interpolation.scheme, (0, false), progress)?;
    if endless.loss() > Endless::LOST {
        let (path, loss) = (path.display(), endless.loss());
        progress.warn(&format!(
            "{path} has structure that --endless loses: patches differ {loss:.1} times as much as two halves of the sample do; \
             loden synthesize keeps it"
        ));
    }
    Ok(Arc::new(endless))
}

/// A map that was made.
struct Made {
    width: usize,
    height: usize,
    seconds: f64,
}

impl SynthesisRequest {
    /// Makes the map, and writes it if there is a file for it. `appearance` is a picture of the sample, for a guide.
    fn sources(
        &self,
        exemplar: Exemplar,
        appearance: impl FnOnce() -> Result<Picture>,
        progress: &dyn Progress,
    ) -> Result<(SourceMap, Made)> {
        let mask = self.mask.as_deref().map(|path| read_mask(path, &exemplar)).transpose()?.or(exemplar.mask.clone());
        let [width, height] = self.size.unwrap_or([exemplar.width, exemplar.height]);
        let mut goal = Goal { tileable: self.tileable, seed: self.seed, ..Goal::new(width, height) };
        if self.size.is_none() {
            let own = |texel: usize| Source::new(texel % width, texel / width);
            let usable = |texel: usize| mask.as_ref().is_none_or(|mask| mask[texel]);
            goal.known = Some((0..width * height).map(|texel| usable(texel).then(|| own(texel))).collect());
        }
        if let Some((path, weight)) = &self.guide {
            let result = lightness(&read_sized(path, [width, height], "result")?);
            goal.guide = Some(Guide { sample: lightness(&appearance()?), result, weight: *weight });
        }
        let exemplar = Exemplar { periodic: self.periodic, mask, ..exemplar };
        let start = Instant::now();
        let sources = synth::synthesize(self.method, &exemplar, &goal, &self.params, progress)?;
        let seconds = start.elapsed().as_secs_f64();
        if let Some(path) = &self.map {
            map::write(&sources, path)?;
        }
        Ok((sources, Made { width, height, seconds }))
    }

    fn picture(&self, path: &Path, progress: &dyn Progress) -> Result<Made> {
        let mut warnings = Vec::new();
        let picture = Picture::read(path, &mut warnings)?;
        warnings.iter().for_each(|warning| progress.warn(warning));
        let (sources, made) = self.sources(Exemplar::of_picture(&picture), || Ok(picture), progress)?;
        map::apply(&sources, path, &self.output)?;
        Ok(made)
    }

    /// The compressed sample, or all samples side by side with the number of the sample of each texel.
    fn samples(&self, path: &Path, options: &Given, progress: &dyn Progress) -> Result<Samples> {
        if self.with.is_empty() {
            let (sample, folder) = compressed_sample(path, options, progress)?;
            return Ok(Samples { sample, places: None, _folder: folder });
        }
        let paths = [path].into_iter().chain(self.with.iter().map(|(path, _)| path.as_path()));
        let samples = paths.map(|path| super::open_btf(path, options, progress)).collect::<Result<Vec<_>>>()?;
        let joined = Joined::new(samples)?;
        let places = joined.places();
        let (sample, folder) = compressed(&joined, progress)?;
        Ok(Samples { sample, places: Some(places), _folder: Some(folder) })
    }

    /// What was made, and the ratio of the sizes of the result and the compressed sample.
    fn material(&self, path: &Path, options: &Given, progress: &dyn Progress) -> Result<(Made, f64)> {
        let Samples { sample, places, .. } = &self.samples(path, options, progress)?;
        let meta = sample.meta();
        let [width, height] = self.size.unwrap_or([meta.width, meta.height]);
        codec::check_mapped(meta, width, height, &self.output)?;
        progress.stage("synthesise");
        let mut exemplar = exemplar(sample, self.features, self.channels, progress)?;
        if let Some(places) = places {
            let weight = |place: &Option<usize>| match place {
                Some(number) if *number > 0 => self.with[number - 1].1,
                _ => 1.0,
            };
            exemplar.weights = Some(places.iter().map(weight).collect());
            exemplar.mask = Some(places.iter().map(Option::is_some).collect());
        }
        let (sources, made) = self.sources(exemplar, || frontal(sample), progress)?;
        let bytes = match self.store {
            Store::Map => codec::store_mapped(sample, &sources, &self.output)?,
            Store::Planes => {
                let parts = Rearranged::new(sample.parts().clone(), Arc::new(sources))?;
                codec::parts::store(&parts, &sample.provenance()?, &self.output)?
            }
        };
        Ok((made, bytes as f64 / sample.source_bytes() as f64))
    }
}

/// A compressed BTF. One that is not compressed is compressed by the default method, into a folder that lives as long as what is
/// returned beside it.
pub(super) fn compressed_sample(
    path: &Path,
    options: &Given,
    progress: &dyn Progress,
) -> Result<(Arc<CompressedBtf>, Option<tempfile::TempDir>)> {
    match open(path, options, progress)?.measured {
        Measured::Compressed(sample) => Ok((sample, None)),
        Measured::Btf(source) => compressed(&*source, progress).map(|(sample, folder)| (sample, Some(folder))),
        Measured::Brdf(_) => Err(Error::unsupported(path, "holds a BRDF, a BTF is needed here")),
    }
}

/// What a synthesis copies from.
struct Samples {
    sample: Arc<CompressedBtf>,
    /// Of several samples side by side, the number of the sample of each texel.
    places: Option<Vec<Option<usize>>>,
    /// Holds the file of a sample that was compressed.
    _folder: Option<tempfile::TempDir>,
}

/// A BTF compressed by the default method, into a folder that lives as long as what is returned beside it.
fn compressed(source: &dyn BtfSource, progress: &dyn Progress) -> Result<(Arc<CompressedBtf>, tempfile::TempDir)> {
    let folder = tempfile::tempdir().map_err(Error::io(std::env::temp_dir()))?;
    let file = folder.path().join("sample.loden");
    let method = codec::by_name(codec::DEFAULT)?;
    let params = Values::defaults(method.params());
    let finish = Finish { measure: false, lossless: None };
    progress.stage("compress the sample");
    codec::compress(method, source, &params, CompressionGoal::Params, finish, &file, progress)?;
    Ok((codec::open(&file)?, folder))
}

/// What the texels of a sample are compared by.
pub(super) fn exemplar(
    sample: &CompressedBtf,
    features: Features,
    channels: usize,
    progress: &dyn Progress,
) -> Result<Exemplar> {
    let appearance = || Exemplar::of_btf(sample, channels, progress);
    let height = || Relief::of_btf(sample, progress).map(|relief| Exemplar::of_relief(&relief));
    match features {
        Features::Appearance => appearance(),
        Features::Height => height(),
        Features::Both => appearance()?.with(&height()?),
    }
}

/// The image of a sample seen from the front, lit from 30 degrees.
fn frontal(sample: &CompressedBtf) -> Result<Picture> {
    let meta = sample.meta();
    let (view, light) = meta.nearest_pair(from_angles(30f32.to_radians(), 0.0), Vec3::Z);
    Ok(stored_picture(meta, &sample.image(view, light)?.to_f32()))
}

/// The lightness of the pixels of a picture, with mean zero and, unless it is constant, unit variance.
fn lightness(picture: &Picture) -> Vec<f32> {
    let display = |c: &Vec3| Encoding::Srgb.encode(luminance(c.to_array()).max(0.0));
    let values: Vec<f32> = picture.rgb.iter().map(display).collect();
    let count = values.len() as f64;
    let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / count;
    let variance = values.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / count;
    let scale = if variance > 1e-12 { 1.0 / variance.sqrt() } else { 0.0 };
    values.iter().map(|v| ((f64::from(*v) - mean) * scale) as f32).collect()
}

/// Reads a picture that has the size of something.
pub(super) fn read_sized(path: &Path, [width, height]: [usize; 2], of: &str) -> Result<Picture> {
    let picture = Picture::read(path, &mut Vec::new())?;
    if (picture.width, picture.height) != (width, height) {
        let found = format!("found {} x {}", picture.width, picture.height);
        return Err(Error::invalid(path, "size", format!("{found}, the {of} has {width} x {height}")));
    }
    Ok(picture)
}

/// The usable texels of a sample: those where the picture `path` is brighter than a quarter of white.
///
/// # Errors
/// Errors of reading the picture; [`Error::Invalid`] if it has another size.
pub fn read_mask(path: &Path, exemplar: &Exemplar) -> Result<Vec<bool>> {
    let picture = read_sized(path, [exemplar.width, exemplar.height], "sample")?;
    Ok(picture.rgb.iter().map(|c| luminance(c.to_array()) > 0.25).collect())
}
