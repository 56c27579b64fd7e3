//! Large results in bands, so that memory is bounded.

use super::super::{Goal, Guide, Source};
use super::sample::Sample;
use super::{Table, optimise, rounds};
use crate::progress::{Progress, Task};
use crate::random::hash;
use crate::{Error, Result};

/// The most texels that are made at a time.
const MOST: usize = 1 << 23;

/// How far a band looks back into the one before, in texels.
const OVERLAP: usize = 96;

/// All sources of a goal.
///
/// # Errors
/// [`Error::Parameter`] if a tileable result is too large; as [`optimise`].
pub(super) fn run_within<const C: usize>(
    sample: &Sample<C>,
    goal: &Goal,
    table: &Table,
    most: usize,
    progress: &dyn Progress,
) -> Result<Vec<Source>> {
    if goal.width * goal.height <= most {
        let task = Task::new(progress, "synthesise", rounds(sample, goal, table));
        return optimise(sample, goal, table, &task);
    }
    if goal.tileable {
        let problem = format!("a tileable result has at most {most} texels: repeat a smaller one");
        return Err(Error::parameter("size", problem));
    }
    let bands = bands(goal, most);
    let goals = || bands.iter().map(|band| Goal::new(band.size[0], band.size[1]));
    let task = Task::new(progress, "synthesise", goals().map(|goal| rounds(sample, &goal, table)).sum());
    let mut sources = vec![Source::default(); goal.width * goal.height];
    for band in &bands {
        let texels = || band.texels(goal.width);
        let given = |texel: usize| goal.known.as_ref().and_then(|known| known[texel]);
        let known = texels().map(|(texel, is_before)| if is_before { Some(sources[texel]) } else { given(texel) });
        let known: Vec<_> = known.collect();
        let goal = Goal {
            seed: hash(&[goal.seed, band.place[0] as u64, band.place[1] as u64]),
            known: known.iter().any(Option::is_some).then_some(known),
            guide: goal.guide.as_ref().map(|guide| Guide {
                result: texels().map(|(texel, _)| guide.result[texel]).collect(),
                ..guide.clone()
            }),
            ..Goal::new(band.size[0], band.size[1])
        };
        let made = optimise(sample, &goal, table, &task)?;
        texels().zip(made).for_each(|((texel, _), source)| sources[texel] = source);
    }
    Ok(sources)
}

/// As [`run_within`], with bounded memory.
///
/// # Errors
/// As [`run_within`].
pub(super) fn run<const C: usize>(
    sample: &Sample<C>,
    goal: &Goal,
    table: &Table,
    progress: &dyn Progress,
) -> Result<Vec<Source>> {
    run_within(sample, goal, table, MOST, progress)
}

/// Part of a result.
struct Band {
    place: [usize; 2],
    size: [usize; 2],
    /// The axis along which bands follow each other, and how many texels of the band are also of the one before.
    axis: usize,
    before: usize,
}

impl Band {
    /// The texels of the result in the band, row by row, and whether they are also in the band before.
    fn texels(&self, width: usize) -> impl Iterator<Item = (usize, bool)> {
        let Self { place: [left, top], size: [columns, rows], axis, before } = *self;
        (0..rows).flat_map(move |y| (0..columns).map(move |x| ((top + y) * width + left + x, [x, y][axis] < before)))
    }
}

/// The bands of a result, along its longer side.
fn bands(goal: &Goal, most: usize) -> Vec<Band> {
    let axis = usize::from(goal.height >= goal.width);
    let size = [goal.width, goal.height];
    let step = (most / size[1 - axis]).max(2 * OVERLAP) - OVERLAP;
    let band = |start: usize| {
        let before = OVERLAP.min(start);
        let (mut place, mut of) = ([0; 2], size);
        (place[axis], of[axis]) = (start - before, (step + before).min(size[axis] - start + before));
        Band { place, size: of, axis, before }
    };
    (0..size[axis]).step_by(step).map(band).collect()
}
