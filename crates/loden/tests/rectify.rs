//! The round trip from a simulated sample through raw photographs to a BTF, compared with a direct measurement.

use std::borrow::Cow;
use std::fs;
use std::path::Path;

use loden::acquire::photograph::{Camera, MANIFEST, photograph};
use loden::acquire::{self, HeightField};
use loden::btf::{MemoryBtf, Texels};
use loden::direction::DirectionSet;
use loden::params::Values;
use loden::progress::Silent;
use loden::rectify::{Options, Outcome, Photographs};
use loden::{Result, metric};

const SIZE: usize = 16;

fn set() -> DirectionSet {
    DirectionSet::from_degrees(vec![[0.0, 0.0], [30.0, 60.0], [60.0, 200.0]]).unwrap()
}

fn sample() -> HeightField {
    let leather = acquire::named("leather").unwrap();
    leather.build(&Values::defaults(leather.params()), 128, 0).unwrap()
}

fn rectified(folder: &Path) -> Result<(MemoryBtf, Vec<Outcome>)> {
    let photographs = Photographs::open(&folder.join(MANIFEST))?;
    let options = Options { size: SIZE, ..Options::default() };
    let mut all = Vec::new();
    let outcomes = photographs.rectify(&options, &Silent, &mut |mut texels| {
        all.append(&mut texels);
        Ok(())
    })?;
    Ok((MemoryBtf::new(photographs.meta(&options), Texels::F32(Cow::Owned(all)))?, outcomes))
}

#[test]
fn rectified_photographs_are_the_directly_measured_btf() {
    let dir = tempfile::tempdir().unwrap();
    let (field, set, folder) = (sample(), set(), dir.path().join("raw"));
    let options = acquire::Options { size: SIZE, spp: 4, ..Default::default() };
    let camera = Camera { pixels: 128, ..Camera::default() };
    assert_eq!(photograph(&field, [&set, &set], &options, &camera, &folder, &Silent).unwrap(), 18);
    let (found, outcomes) = rectified(&folder).unwrap();
    for outcome in &outcomes {
        assert!(outcome.refused.is_none() && outcome.error.unwrap() < 0.15, "{outcome:?}");
    }
    let mut direct = Vec::new();
    let options = acquire::Options { spp: 256, ..options };
    acquire::acquire(&field, &set, &set, &options, &Silent, &mut |_, mut texels| {
        direct.append(&mut texels);
        Ok(())
    })
    .unwrap();
    let meta = loden::btf::BtfSource::meta(&found).clone();
    let direct = MemoryBtf::new(meta, Texels::F32(Cow::Owned(direct))).unwrap();
    let report = metric::compare(&direct, &found, &Silent).unwrap();
    println!("mean error {:.5}", report.mean_abs_error);
    assert!(report.mean_abs_error < 0.006, "{}", report.mean_abs_error);
}

#[test]
fn a_covered_frame_is_refused_by_name_and_the_nearest_light_takes_its_place() {
    let dir = tempfile::tempdir().unwrap();
    let (field, set, folder) = (sample(), set(), dir.path().join("raw"));
    let options = acquire::Options { size: SIZE, spp: 1, ..Default::default() };
    let camera = Camera { pixels: 96, exposures: 1, ..Camera::default() };
    photograph(&field, [&set, &set], &options, &camera, &folder, &Silent).unwrap();
    // a photograph of nothing
    fs::copy(folder.join("dark.png"), folder.join("v01/l02_e0.png")).unwrap();
    let (found, outcomes) = rectified(&folder).unwrap();
    let refused: Vec<_> = outcomes.iter().filter(|o| o.refused.is_some()).collect();
    assert_eq!(refused.len(), 1);
    assert!(refused[0].file.ends_with("v01/l02_e0.png"), "{:?}", refused[0]);
    let image = |light| loden::btf::BtfSource::image(&found, 1, light).unwrap().to_f32().into_owned();
    assert!(image(2) == image(0) || image(2) == image(1));
    assert_ne!(image(0), image(1));
    for light in 0..2 {
        fs::copy(folder.join("dark.png"), folder.join(format!("v01/l0{light}_e0.png"))).unwrap();
    }
    let error = rectified(&folder).err().unwrap().to_string();
    assert!(error.contains("v01") && error.contains("no bright ring"), "{error}");
}
