//! Texels that are painted on the page.

use std::path::{Path, PathBuf};

use glam::Vec3;
use loden::output::write_file;
use loden::picture::Picture;
use loden::{Error, Result};
use serde::Deserialize;

use crate::Studio;
use crate::failure::Answer;
use crate::images::encoded;

/// Texels of a mask, at most.
const TEXELS: usize = 1 << 24;

/// Painted texels: how many are not painted, then how many are, in turn, row by row.
#[derive(Debug, Clone, Deserialize)]
pub(crate) struct Painted {
    width: usize,
    height: usize,
    runs: Vec<usize>,
}

/// A mask and the file that it is written to, which the command line names.
pub(super) struct Mask {
    painted: Painted,
    /// A picture beside the output.
    pub path: PathBuf,
}

impl Painted {
    /// The mask for an output of this name.
    pub(super) fn beside(self, studio: &Studio, output: &Path) -> Answer<Mask> {
        self.check()?;
        let stem = output.file_stem().unwrap_or_default().to_string_lossy();
        let path = studio.folders.new_output(&format!("{stem}-mask.png"), &["png"])?;
        Ok(Mask { painted: self, path })
    }

    fn check(&self) -> Result<()> {
        let texels = self.width.checked_mul(self.height).filter(|texels| (1..=TEXELS).contains(texels));
        let sum = self.runs.iter().try_fold(0usize, |sum, run| sum.checked_add(*run));
        let painted = self.runs.iter().skip(1).step_by(2).any(|run| *run > 0);
        match texels {
            Some(texels) if sum == Some(texels) && painted => Ok(()),
            Some(_) if !painted => Err(Error::parameter("mask", "no texel is painted")),
            _ => {
                let problem = format!("expected runs that add up to the texels of {} x {}", self.width, self.height);
                Err(Error::parameter("mask", problem))
            }
        }
    }

    /// Whether each texel is painted, shape (y, x).
    pub fn texels(&self) -> Result<Vec<bool>> {
        self.check()?;
        Ok(self.runs.iter().enumerate().flat_map(|(k, run)| std::iter::repeat_n(k % 2 == 1, *run)).collect())
    }

    /// White where texels are painted, else black.
    fn picture(&self) -> Picture {
        let runs = self.runs.iter().enumerate();
        let rgb = runs.flat_map(|(k, run)| std::iter::repeat_n(Vec3::splat((k % 2) as f32), *run)).collect();
        Picture { width: self.width, height: self.height, rgb }
    }
}

impl Mask {
    /// Writes the mask for some work, and removes it if the work does not succeed.
    pub fn during<T>(&self, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let png = encoded(&self.painted.picture()).map_err(|failure| Error::parameter("mask", failure.message()))?;
        write_file(&self.path, |file| file.write_all(&png))?;
        let done = work();
        if done.is_err() {
            // the error of the work says more than one of removing
            let _ = std::fs::remove_file(&self.path);
        }
        done
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_texels_row_by_row() {
        let painted = Painted { width: 3, height: 2, runs: vec![2, 3, 1] };
        assert!(painted.check().is_ok());
        assert_eq!(
            painted.picture().to_srgb8().iter().step_by(3).copied().collect::<Vec<_>>(),
            [0, 0, 255, 255, 255, 0]
        );
        for runs in [vec![2, 3], vec![6], vec![7, usize::MAX], vec![2, 0, 4], vec![]] {
            assert!(Painted { runs: runs.clone(), ..painted.clone() }.check().is_err(), "{runs:?}");
        }
        assert!(Painted { width: usize::MAX, ..painted }.check().is_err());
    }
}
