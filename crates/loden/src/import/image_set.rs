//! A BTF made of picture files, one per pair of directions.

use std::borrow::Cow;
use std::path::Path;

use super::Conventions;
use super::pattern::{is_grid, pair_degrees};
use super::turned::{common_size, turned_back};
use crate::btf::{BtfMeta, BtfSource, Cosine, SampleType, Texels};
use crate::color::Encoding;
use crate::direction::DirectionSet;
use crate::params::{Kind, Param, YesNo};
use crate::picture::decode::{Decoded, Numbers, Reading, decode};
use crate::{Error, Result};

/// Maximum number of rows and columns, checked before anything is allocated.
const MAX_SIDE: usize = 1 << 14;
/// Maximum number of pairs.
const MAX_PAIRS: usize = 1 << 24;

/// A source of picture files.
pub(super) trait Files: Send + Sync {
    /// The archive, folder or list.
    fn path(&self) -> &Path;
    /// The name of file `index` inside.
    fn name(&self, index: usize) -> &str;
    /// The content of file `index`.
    fn read(&self, index: usize) -> Result<Vec<u8>>;
    /// Total size in bytes.
    fn bytes(&self) -> u64;
    /// How pictures are read.
    fn reading(&self) -> Reading {
        Reading { strict: true, bonn: false }
    }
}

/// Assignment of files to pairs.
pub(super) struct Plan {
    pub views: DirectionSet,
    pub lights: DirectionSet,
    /// The file of each (view, light).
    pub image: Vec<Option<usize>>,
    /// Divisor of linear light for each file; empty for 1.
    pub exposure: Vec<f32>,
    /// By how many degrees the sample of each file was turned, counter-clockwise; empty for none.
    pub turns: Vec<f64>,
    pub cosine: Cosine,
    pub warnings: Vec<String>,
    pub facts: Vec<(&'static str, String)>,
}

/// The parameter that completes sparse sets.
pub(super) const COMPLETE: Param = Param {
    name: "complete",
    unit: "",
    kind: Kind::Choice(&["yes", "no"]),
    default: "no",
    doc: "Whether a set with less than half of all pairs of its views and lights is completed: pairs that were not measured then \
          repeat the nearest light of their view. By default such a set keeps its own list of pairs.",
};

impl Plan {
    /// Turns a sparse set into a list of pairs, unless it is to be completed.
    pub(super) fn listed_unless(mut self, complete: YesNo) -> Result<Self> {
        let (all, is_listed) = (self.image.len(), self.lights.seen_from().is_some());
        let measured: Vec<usize> = (0..all).filter(|i| self.image[*i].is_some()).collect();
        let stays = complete == YesNo::Yes || is_grid(&self.views, measured.len(), all);
        if measured.is_empty() || measured.len() == all || (stays && !is_listed) {
            return Ok(self);
        }
        if is_listed {
            let without = all - measured.len();
            self.warnings.push(format!("{without} of {all} listed pairs have no picture and are left out"));
        }
        let degrees = measured.iter().map(|&i| pair_degrees(&self.views, &self.lights, i));
        let listed = DirectionSet::of_pairs(&degrees.collect::<Vec<_>>())?;
        (self.views, self.lights) = (DirectionSet::normal(), listed);
        self.image.retain(Option::is_some);
        Ok(self)
    }
}

/// An opened set, which decodes images on demand.
pub(super) struct ImageSet<F> {
    meta: BtfMeta,
    /// Encoding of the numbers of the first file; texels are linear where exposures are divided out.
    encoding: Encoding,
    /// Encoding that the user states.
    given: Option<Encoding>,
    files: F,
    /// For each (view, light); missing pairs repeat another.
    image: Vec<usize>,
    exposure: Vec<f32>,
    /// By how many degrees the sample of each file was turned; empty for none.
    turns: Vec<f64>,
    /// Size of the pictures in the files.
    picture: [usize; 2],
    missing: Vec<(usize, usize)>,
    warnings: Vec<String>,
    facts: Vec<(&'static str, String)>,
}

impl<F: Files> ImageSet<F> {
    /// Opens one picture to learn size, number type and encoding.
    pub(super) fn new(files: F, plan: Plan, options: &Conventions) -> Result<Self> {
        let Plan { views, lights, image, exposure, turns, cosine, mut warnings, facts } = plan;
        if image.len() > MAX_PAIRS {
            let (found, limit) = (image.len() as u64, MAX_PAIRS as u64);
            return Err(Error::Limit { path: files.path().into(), field: "pairs".into(), found, limit });
        }
        let first = image.iter().flatten().next().copied();
        let first =
            first.ok_or_else(|| Error::invalid(files.path(), "content", "found no picture, expected one per pair"))?;
        let decoded = read(&files, first, None)?;
        warnings.extend(decoded.warnings.iter().map(|warning| format!("{}: {warning}", files.name(first))));
        let picture = [decoded.width, decoded.height];
        let [width, height] = if turns.is_empty() { picture } else { common_size(picture, &turns) };
        let (numbers, encoding) = decoded.resolved(options.encoding);
        let missing: Vec<_> =
            (0..image.len()).filter(|&i| image[i].is_none()).map(|i| (i / lights.len(), i % lights.len())).collect();
        let image = fill(image, &missing, &views, &lights, &mut warnings);
        let scaled = !exposure.is_empty();
        let meta = BtfMeta {
            width,
            height,
            views,
            lights,
            encoding: if scaled { Encoding::Linear } else { encoding },
            cosine: options.cosine.unwrap_or(cosine),
            sample_type: if matches!(numbers, Numbers::U8(_)) && !scaled { SampleType::U8 } else { SampleType::F32 },
        };
        Ok(Self {
            meta,
            encoding,
            given: options.encoding,
            files,
            image,
            exposure,
            turns,
            picture,
            missing,
            warnings,
            facts,
        })
    }

    fn decode(&self, view: usize, light: usize) -> Result<Numbers> {
        let file = self.image[view * self.meta.lights.len() + light];
        let decoded = read(&self.files, file, Some(self.picture))?;
        let (numbers, encoding) = decoded.resolved(self.given);
        if encoding != self.encoding {
            return Err(
                self.wrong(file, &format!("its values are {encoding}, those of the first picture {}", self.encoding))
            );
        }
        let numbers = match self.turns.get(file) {
            Some(turn) => turned_back(numbers, self.picture, *turn, [self.meta.width, self.meta.height], encoding),
            None => numbers,
        };
        let values = match (numbers, self.meta.sample_type) {
            (numbers @ Numbers::U8(_), SampleType::U8) => return Ok(numbers),
            (_, SampleType::U8) => return Err(self.wrong(file, "more than 8 bits, other than the first picture")),
            (Numbers::U8(numbers), _) => numbers.iter().map(|&v| f32::from(v) / 255.0).collect(),
            (Numbers::U16(numbers), _) => numbers.iter().map(|&v| f32::from(v) / 65_535.0).collect(),
            (Numbers::F32(numbers), _) => numbers,
        };
        let mut values: Vec<f32> = values;
        if let Some(exposure) = self.exposure.get(file) {
            values.iter_mut().for_each(|v| *v = self.encoding.decode(*v) / exposure);
        }
        match values.iter().position(|v| !v.is_finite()) {
            None => Ok(Numbers::F32(values)),
            Some(i) => Err(self.wrong(file, &format!("number {i} is not finite"))),
        }
    }

    fn wrong(&self, file: usize, problem: &str) -> Error {
        Error::invalid(self.files.path(), self.files.name(file), problem)
    }

    fn images(&self, view: usize, lights: std::ops::Range<usize>) -> Result<Texels<'_>> {
        let (mut bytes, mut floats) = (Vec::new(), Vec::new());
        for light in lights {
            match self.decode(view, light)? {
                Numbers::U8(mut numbers) => bytes.append(&mut numbers),
                Numbers::F32(mut numbers) => floats.append(&mut numbers),
                Numbers::U16(_) => {}
            }
        }
        Ok(match self.meta.sample_type {
            SampleType::U8 => Texels::U8(Cow::Owned(bytes)),
            _ => Texels::F32(Cow::Owned(floats)),
        })
    }
}

impl<F: Files> BtfSource for ImageSet<F> {
    fn meta(&self) -> &BtfMeta {
        &self.meta
    }

    fn view(&self, view: usize) -> Result<Texels<'_>> {
        self.images(view, 0..self.meta.lights.len())
    }

    fn image(&self, view: usize, light: usize) -> Result<Texels<'_>> {
        self.images(view, light..light + 1)
    }

    fn source_bytes(&self) -> u64 {
        self.files.bytes()
    }

    fn missing(&self) -> &[(usize, usize)] {
        &self.missing
    }

    fn facts(&self) -> &[(&'static str, String)] {
        &self.facts
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

/// Decodes one file, which must be of the expected size.
fn read(files: &impl Files, index: usize, expected: Option<[usize; 2]>) -> Result<Decoded> {
    let wrong = |problem: String| Error::invalid(files.path(), files.name(index), problem);
    let decoded = decode(&files.read(index)?, files.reading()).map_err(|problem| wrong(problem.to_string()))?;
    let [width, height] = [decoded.width, decoded.height];
    match expected {
        Some([w, h]) if [w, h] != [width, height] => {
            Err(wrong(format!("{width} x {height} texels, the other images have {w} x {h}")))
        }
        _ if width.max(height) > MAX_SIDE => {
            Err(wrong(format!("{width} x {height} texels, more than {MAX_SIDE} a side are not read")))
        }
        _ => Ok(decoded),
    }
}

/// Substitutes missing pairs by the image of the nearest measured light of the same view.
fn fill(
    image: Vec<Option<usize>>,
    missing: &[(usize, usize)],
    views: &DirectionSet,
    lights: &DirectionSet,
    warnings: &mut Vec<String>,
) -> Vec<usize> {
    let any = image.iter().flatten().next().copied().unwrap_or(0);
    let substitute = |view: usize, light: usize| {
        let row = &image[view * lights.len()..][..lights.len()];
        let nearness = |l: usize| lights.directions()[l].dot(lights.directions()[light]);
        (0..lights.len())
            .filter(|&l| row[l].is_some())
            .max_by(|&a, &b| nearness(a).total_cmp(&nearness(b)))
            .and_then(|l| row[l])
    };
    let filled =
        (0..image.len()).map(|i| image[i].or_else(|| substitute(i / lights.len(), i % lights.len())).unwrap_or(any));
    if let Some(&(view, light)) = missing.first() {
        let ([tl, pl], [tv, pv]) = (lights.degrees()[light], views.degrees()[view]);
        warnings.push(format!(
            "{} of {} pairs are missing, the first is tl{tl:03} pl{pl:03} tv{tv:03} pv{pv:03}; each repeats the nearest light of its view",
            missing.len(),
            image.len()
        ));
    }
    filled.collect()
}
