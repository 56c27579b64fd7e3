//! `curet-images`: the photographs of one sample of the CUReT database.
//!
//! # Format
//! A folder with `NN-001.bmp` to `NN-205.bmp`, or the same in another picture format: NN is the sample, the other number the
//! pair of directions. `table.txt` in the folder or its parent lists the directions, as for `curet`.
//!
//! # Limits
//! The photographs of the database are not rectified: the sample appears in perspective, and a texel shows a
//! different point of it in each view. Rectify the pictures first and keep their names. Each of the 205 pairs combines one of
//! about 127 views with one of about 55 lights: a BTF with its own list of pairs, unless it is to be completed.
//!
//! # References
//! dana1999

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::Vec3;

use super::curet::{PAIRS, read_table};
use super::image_set::{COMPLETE, ImageSet, Plan};
use super::rti::Listed;
use super::{Conventions, Importer, Measured, located};
use crate::btf::Cosine;
use crate::direction::{DirectionSet, phi, theta};
use crate::params::{Param, Params, Values, YesNo};
use crate::{Error, Result};

/// Cosine of the angle below which directions count as the same: a quarter of a degree.
const SAME: f32 = 0.999_99;
const TABLE: &str = "table.txt";

pub(super) struct CuretImages;

crate::params! {
    struct Options {
        conventions: Conventions,
        complete: YesNo => COMPLETE,
    }
}

impl Importer for CuretImages {
    fn name(&self) -> &'static str {
        "curet-images"
    }

    fn doc(&self) -> &'static str {
        "Folder with the photographs of one CUReT sample (`01-001.bmp` ...), with `table.txt` in it or in its parent."
    }

    fn recognises(&self, path: &Path) -> Result<bool> {
        Ok(path.is_dir() && !photographs(path)?.is_empty())
    }

    fn params(&self) -> &'static [Param] {
        Options::TABLE
    }

    fn open(&self, path: &Path, options: &Values) -> Result<Measured> {
        let Options { conventions: options, complete } = Options::from_values(options)?;
        let found = photographs(path)?;
        let pairs = read_table(&table(path))?;
        let (mut lights, mut views) = (Vec::new(), Vec::new());
        let places: Vec<[usize; 2]> =
            pairs.iter().map(|&(wi, wo)| [place(&mut views, wo), place(&mut lights, wi)]).collect();
        let mut image = vec![None; views.len() * lights.len()];
        for (index, (name, pair)) in found.iter().enumerate() {
            let [view, light] = places[pair - 1];
            if let Some(other) = image[view * lights.len() + light].replace(index) {
                let problem = format!("the same sample and directions as {}", found[other].0);
                return Err(Error::invalid(path, name, problem));
            }
        }
        let plan = Plan {
            views: set(&views).map_err(located(path))?,
            lights: set(&lights).map_err(located(path))?,
            image,
            exposure: Vec::new(),
            turns: Vec::new(),
            cosine: Cosine::Included,
            warnings: vec!["photographs of this database are not rectified".into()],
            facts: options.reasons("not stated by the files", "not stated by the files; photographs have it"),
        };
        let plan = plan.listed_unless(complete).map_err(located(path))?;
        let files = Listed::new(&path.join(TABLE), found.into_iter().map(|(name, _)| name).collect())?;
        Ok(Measured::Btf(Arc::new(ImageSet::new(files, plan, &options)?)))
    }

    fn files(&self, path: &Path) -> Result<Vec<PathBuf>> {
        let found = photographs(path)?.into_iter().map(|(name, _)| path.join(name));
        Ok(found.chain([table(path)]).collect())
    }
}

/// The file of directions, in the folder or its parent.
fn table(folder: &Path) -> PathBuf {
    let inside = folder.join(TABLE);
    let above = folder.parent().unwrap_or(Path::new("")).join(TABLE);
    if !inside.is_file() && above.is_file() { above } else { inside }
}

/// The names of the form `NN-001.bmp` in order, each with the number of its pair.
fn photographs(folder: &Path) -> Result<Vec<(String, usize)>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))? {
        let name = entry.map_err(Error::io(folder))?.file_name().to_string_lossy().into_owned();
        if let Some(pair) = pair(&name) {
            found.push((name, pair));
        }
    }
    found.sort();
    Ok(found)
}

fn pair(name: &str) -> Option<usize> {
    let (sample, rest) = name.split_once('-')?;
    let (pair, extension) = rest.split_once('.')?;
    let digits = |text: &str, count| text.len() == count && text.bytes().all(|b| b.is_ascii_digit());
    let picture = ["bmp", "png", "jpg", "tif", "tiff", "exr"].iter().any(|e| extension.eq_ignore_ascii_case(e));
    let pair = pair.parse().ok().filter(|_| digits(sample, 2) && digits(pair, 3) && picture)?;
    (1..=PAIRS).contains(&pair).then_some(pair)
}

/// The index of `direction` in the list, to which it is added if necessary.
fn place(list: &mut Vec<Vec3>, direction: Vec3) -> usize {
    list.iter().position(|known| known.dot(direction) > SAME).unwrap_or_else(|| {
        list.push(direction);
        list.len() - 1
    })
}

fn set(directions: &[Vec3]) -> Result<DirectionSet> {
    let degrees = |w: &Vec3| [theta(*w), phi(*w)].map(|angle| f64::from(angle).to_degrees());
    DirectionSet::from_degrees(directions.iter().map(degrees).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::direction::from_angles;

    /// The angles of a pair in the order of the table: theta_v, phi_v, theta_i, phi_i in radians; views and lights recur.
    fn angles(pair: usize) -> [f32; 4] {
        [0.1 + 0.05 * (pair % 20) as f32, 0.3, 0.1 + 0.1 * (pair / 20) as f32, -0.4]
    }

    fn database(pairs: &[usize]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let row = |pair| {
            let [a, b, c, d] = angles(pair);
            format!("{pair} {a} {b} {c} {d}\n")
        };
        std::fs::write(folder.path().join("table.txt"), (1..=PAIRS).map(row).collect::<String>()).unwrap();
        let sample = folder.path().join("sample07");
        std::fs::create_dir(&sample).unwrap();
        for pair in pairs {
            let picture = image::RgbImage::from_pixel(4, 3, image::Rgb([*pair as u8, 1, 2]));
            picture.save(sample.join(format!("07-{pair:03}.bmp"))).unwrap();
        }
        folder
    }

    #[test]
    fn photographs_stand_where_the_table_puts_them() {
        let folder = database(&[1, 17, 40, 205]);
        let path = folder.path().join("sample07");
        let listed = super::super::open(&path, &Default::default()).unwrap();
        let meta = listed.meta();
        assert_eq!((meta.views.len(), meta.lights.len(), listed.missing().len()), (1, 4, 0));
        for pair in [1, 17, 40, 205] {
            let [theta_v, phi_v, theta_i, phi_i] = angles(pair);
            let place = meta.nearest_pair(from_angles(theta_i, phi_i), from_angles(theta_v, phi_v));
            let (wi, wo) = meta.pair(place.0, place.1);
            assert!(wi.dot(from_angles(theta_i, phi_i)) > 0.999_999 && wo.dot(from_angles(theta_v, phi_v)) > 0.999_999);
            let image = listed.image(place.0, place.1).unwrap().to_f32().to_vec();
            assert_eq!((image[0] * 255.0).round(), pair as f32);
        }
        let complete = crate::params::Given::default().with("complete", "yes");
        let source = super::super::open(&path, &complete).unwrap();
        let meta = source.meta();
        assert_eq!([meta.width, meta.height, meta.views.len(), meta.lights.len()], [4, 3, 20, 11]);
        assert_eq!(source.missing().len(), 20 * 11 - 4);
        for pair in [1, 17, 40, 205] {
            let [theta_v, phi_v, theta_i, phi_i] = angles(pair);
            let nearest = |set: &DirectionSet, w: Vec3| {
                let close = |d: &Vec3| d.dot(w) > 0.999_999;
                set.directions().iter().position(close).unwrap()
            };
            let view = nearest(&meta.views, from_angles(theta_v, phi_v));
            let light = nearest(&meta.lights, from_angles(theta_i, phi_i));
            assert!(!source.missing().contains(&(view, light)));
            let image = source.image(view, light).unwrap().to_f32().to_vec();
            assert_eq!((image[0] * 255.0).round(), pair as f32);
        }
        assert!(source.warnings().iter().any(|w| w.contains("not rectified")));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let folder = database(&[1, 2]);
        let path = folder.path().join("sample07");
        let error = |what: &str| {
            let error = super::super::open(&path, &Default::default()).err().unwrap().to_string();
            assert!(error.contains(what), "{error}");
        };
        std::fs::copy(path.join("07-001.bmp"), path.join("08-001.bmp")).unwrap();
        error("07-001.bmp");
        std::fs::remove_file(path.join("08-001.bmp")).unwrap();
        std::fs::write(folder.path().join("table.txt"), "1 0 0 0 0\n").unwrap();
        error("table.txt");
        std::fs::remove_file(folder.path().join("table.txt")).unwrap();
        error("table.txt");
    }
}
