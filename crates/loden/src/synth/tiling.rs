//! Tiling: the sample again and again.

use super::{Exemplar, Goal, Source, SourceMap, Synthesis};
use crate::Result;
use crate::btf::Rect;
use crate::params::{Param, Values};
use crate::progress::Progress;

/// # Model
/// Tiles of the size of the largest rectangle of usable texels, from the top left corner. For a tileable result, the tiles
/// are cut so that a whole number of them fits.
///
/// # Limits
/// Edges are visible unless the sample is periodic.
pub(super) struct Tiling;

impl Synthesis for Tiling {
    fn name(&self) -> &'static str {
        "tiling"
    }

    fn doc(&self) -> &'static str {
        "The sample repeated, with visible edges: what the other methods must beat."
    }

    fn params(&self) -> &'static [Param] {
        &[]
    }

    fn synthesize(
        &self,
        exemplar: &Exemplar,
        goal: &Goal,
        _params: &Values,
        _progress: &dyn Progress,
    ) -> Result<SourceMap> {
        let tile = exemplar.largest_rectangle();
        let columns = places(goal.width, tile.width, goal.tileable);
        let rows = places(goal.height, tile.height, goal.tileable);
        Ok(SourceMap::from_fn(goal.width, goal.height, |x, y| Source::new(tile.x + columns[x], tile.y + rows[y])))
    }
}

/// The place within its tile of each of `size` texels along one axis.
fn places(size: usize, tile: usize, tileable: bool) -> Vec<usize> {
    let tiles = size.div_ceil(tile);
    let begin = |texel: usize| {
        if tileable { (texel * tiles / size * size).div_ceil(tiles) } else { texel / tile * tile }
    };
    (0..size).map(|texel| texel - begin(texel)).collect()
}

impl Exemplar {
    /// The largest rectangle of usable texels, the first one of several.
    fn largest_rectangle(&self) -> Rect {
        let mut best = Rect { x: 0, y: 0, width: 0, height: 0 };
        // usable texels from this row upwards, by column
        let mut heights = vec![0usize; self.width];
        for y in 0..self.height {
            for (x, height) in heights.iter_mut().enumerate() {
                *height = if self.is_usable(x, y) { *height + 1 } else { 0 };
            }
            // Close every rectangle at the first column that is lower
            let mut open: Vec<(usize, usize)> = Vec::new();
            for (x, &height) in heights.iter().chain(&[0]).enumerate() {
                let mut first = x;
                while let Some((left, top)) = open.pop_if(|(_, top)| *top > height) {
                    let found = Rect { x: left, y: y + 1 - top, width: x - left, height: top };
                    if found.texels() > best.texels() {
                        best = found;
                    }
                    first = left;
                }
                open.push((first, height));
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_repeat_and_are_cut_where_the_result_is_a_tile() {
        assert_eq!(places(7, 3, false), [0, 1, 2, 0, 1, 2, 0]);
        assert_eq!(places(7, 3, true), [0, 1, 2, 0, 1, 0, 1]);
        assert_eq!(places(6, 3, true), places(6, 3, false));
        assert_eq!(places(2, 5, true), [0, 1]);
    }

    #[test]
    fn the_largest_rectangle_is_found_around_a_mask() {
        let mut exemplar = Exemplar::new(5, 4, 1, vec![0.0; 20]);
        assert_eq!(exemplar.largest_rectangle(), Rect { x: 0, y: 0, width: 5, height: 4 });
        // . . x . .
        // . . . . .
        // . . . . .
        // x . . . x
        exemplar.mask = Some((0..20).map(|texel| ![2, 15, 19].contains(&texel)).collect());
        assert_eq!(exemplar.largest_rectangle(), Rect { x: 0, y: 1, width: 5, height: 2 });
        exemplar.mask = Some((0..20).map(|texel| texel == 7).collect());
        assert_eq!(exemplar.largest_rectangle(), Rect { x: 2, y: 1, width: 1, height: 1 });
    }
}
