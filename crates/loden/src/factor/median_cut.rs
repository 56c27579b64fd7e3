//! Median cut: points in boxes, each split at the median into halves with equal numbers of points.
//!
//! Choose it for speed and for predictable cluster sizes; [`super::kmeans`] and [`super::tree`] have smaller errors.
//!
//! # Model
//! A box is split in its largest dimension, at the median: the lower floor(n/2) of its points form one half; equal
//! values are ordered by point number. The [`Rule`] says which box is split next; of equal ones, the older. Points are
//! read in passes, page by page, a page being a few dimensions: one pass measures all boxes that may still be split,
//! and the order of splits is determined afterwards. The measure of a box in a page bounds that of its halves, so most
//! pages need not be read again.
//!
//! # Limits
//! The rules rely on a half being no larger in any dimension than its box. The number of passes is at most the depth of
//! the splits, the logarithm of the number of points.
//!
//! # References
//! heckbert1982

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, BinaryHeap};
use std::ops::Range;

use rayon::prelude::*;

use super::kmeans::Partition;
use crate::Result;

/// Choice of the next box to split.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// The box nearest to the root, the oldest of several: gives 2^level boxes of equal size.
    Balanced,
    /// The box with the longest edge.
    LongestEdge,
    /// The box with the largest product of number of points and longest edge.
    Population,
    /// The box with the largest sum of squared deviations in one dimension.
    Variance,
}

/// The size of a box in a dimension.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// The largest value minus the smallest.
    Edge,
    /// The sum of the squared deviations from the mean.
    Deviation,
}

impl Rule {
    /// The measure that the rule uses.
    pub fn measure(self) -> Measure {
        if self == Self::Variance { Measure::Deviation } else { Measure::Edge }
    }

    /// Boxes of higher priority are split first.
    fn priority(self, level: u32, points: usize, size: f32) -> f64 {
        match self {
            Self::Balanced => -f64::from(level),
            Self::LongestEdge | Self::Variance => f64::from(size),
            Self::Population => points as f64 * f64::from(size),
        }
    }
}

/// Points whose values lie in pages of a few dimensions each.
pub trait Pages: Sync {
    /// Number of points.
    fn points(&self) -> usize;

    /// Number of pages.
    fn pages(&self) -> usize;

    /// Number of pages that are read together.
    fn together(&self) -> usize;

    /// For each group of points of each page, the largest measure among the dimensions of the page and its dimension within
    /// the page, the first of equals.
    ///
    /// # Errors
    /// Errors of the source.
    fn measure(&self, pages: &[(usize, Vec<&[u32]>)], measure: Measure) -> Result<Vec<Vec<(f32, usize)>>>;

    /// For each list of points, their values in one dimension of a page.
    ///
    /// # Errors
    /// Errors of the source.
    fn values(&self, lists: &[(usize, usize, &[u32])]) -> Result<Vec<Vec<f32>>>;

    /// Tells the source that the caller is done for now with pages that are read together.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`].
    fn done(&self, pages: Range<usize>) -> Result<()>;
}

/// Pages in which a box is measured first: those where it can be largest. Most others then need not be read.
const FIRST_PAGES: usize = 8;

/// Boxes with fewer points do not keep their bounds per page.
const BOUNDED: usize = 16;

/// Relative rounding error of a sum of squares.
const SLACK: f32 = 1e-5;

#[derive(Debug, Default)]
struct Cell {
    /// Ascending; empty after a split.
    points: Vec<u32>,
    /// Number of points, also after a split.
    count: usize,
    level: u32,
    /// The largest measure, its page and dimension.
    size: Option<(f32, usize, usize)>,
    /// Upper bound of the size.
    limit: f32,
    /// Upper bounds of the measure in each page; empty if unknown.
    bounds: Vec<f32>,
    halves: Option<[usize; 2]>,
}

impl Cell {
    /// Whether a page can hold the largest measure, or an equal one in an earlier dimension.
    fn needs(&self, page: usize) -> bool {
        let bound = self.bounds.get(page).copied().unwrap_or(f32::INFINITY);
        self.size.is_none_or(|(size, at, _)| bound > size || bound == size && page <= at)
    }

    fn measured(&mut self, page: usize, (size, dimension): (f32, usize), measure: Measure) {
        if let Some(bound) = self.bounds.get_mut(page) {
            *bound = if measure == Measure::Edge { size } else { size * (1.0 + SLACK) };
        }
        let better = |(old, at, _): (f32, usize, usize)| size > old || size == old && page < at;
        if self.size.is_none_or(better) {
            self.size = Some((size, page, dimension));
        }
    }
}

/// Divides the points into at most `count` boxes, numbered from lower halves to upper ones.
///
/// # Errors
/// Errors of the pages.
pub fn median_cut(pages: &impl Pages, count: usize, rule: Rule) -> Result<Partition> {
    let mut tree = Tree { pages, count, rule, cells: Vec::new() };
    let points: Vec<u32> = (0..pages.points() as u32).collect();
    tree.cells.push(Cell { count: points.len(), points, limit: f32::INFINITY, ..Cell::default() });
    loop {
        let unmeasured = tree.candidates(|cell| cell.size.is_none());
        tree.measure(&unmeasured)?;
        let uncut = tree.candidates(|cell| cell.halves.is_none() && cell.size.is_some());
        if uncut.is_empty() {
            break;
        }
        tree.cut(&uncut)?;
    }
    Ok(tree.partition())
}

struct Tree<'a, P> {
    pages: &'a P,
    count: usize,
    rule: Rule,
    cells: Vec<Cell>,
}

impl<P: Pages> Tree<'_, P> {
    /// The priority of a cell, or an upper bound of it; `None` if it cannot be split.
    fn priority(&self, cell: &Cell) -> Option<f64> {
        let size = cell.size.map_or(cell.limit, |(size, ..)| size);
        (cell.count > 1 && size > 0.0).then(|| self.rule.priority(cell.level, cell.count, size))
    }

    /// The cells accepted by `some` that may be among the first to be split.
    fn candidates(&self, some: impl Fn(&Cell) -> bool) -> Vec<usize> {
        let known = self.cells.iter().filter(|cell| cell.size.is_some());
        let mut priorities: Vec<f64> = known.filter_map(|cell| self.priority(cell)).collect();
        priorities.sort_by(|a, b| b.total_cmp(a));
        // a cell is not split if at least this many come before it
        let cuts = self.count.saturating_sub(1);
        let least =
            if cuts == 0 { f64::INFINITY } else { priorities.get(cuts - 1).copied().unwrap_or(f64::NEG_INFINITY) };
        let inside = |i: &usize| {
            let cell = &self.cells[*i];
            cuts > 0 && some(cell) && self.priority(cell).is_some_and(|priority| priority >= least)
        };
        (0..self.cells.len()).filter(inside).collect()
    }

    /// Measures cells: first in the pages where they can be largest, then in those that may still hold a larger
    /// measure.
    fn measure(&mut self, some: &[usize]) -> Result<()> {
        let mut first: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for &i in some {
            let bounds = &self.cells[i].bounds;
            let mut pages: Vec<usize> = (0..bounds.len()).collect();
            if pages.len() > FIRST_PAGES {
                pages.select_nth_unstable_by(FIRST_PAGES, |&a, &b| bounds[b].total_cmp(&bounds[a]).then(a.cmp(&b)));
                pages.truncate(FIRST_PAGES);
            }
            pages.into_iter().for_each(|page| first.entry(page).or_default().push(i));
        }
        let count = self.pages.pages();
        for begin in (0..count).step_by(self.pages.together()) {
            let range = begin..(begin + self.pages.together()).min(count);
            self.visit(first.range(range.clone()).map(|(page, cells)| (*page, cells.clone())).collect(), range)?;
        }
        for begin in (0..count).step_by(self.pages.together()) {
            let range = begin..(begin + self.pages.together()).min(count);
            let needed = |page: usize| some.iter().copied().filter(|&i| self.cells[i].needs(page)).collect::<Vec<_>>();
            let jobs = range.clone().map(|page| (page, needed(page))).filter(|(_, cells)| !cells.is_empty()).collect();
            self.visit(jobs, range)?;
        }
        Ok(())
    }

    /// Measures cells in pages, all within `range`.
    fn visit(&mut self, jobs: Vec<(usize, Vec<usize>)>, range: Range<usize>) -> Result<()> {
        if jobs.is_empty() {
            return Ok(());
        }
        let measure = self.rule.measure();
        let groups = |cells: &Vec<usize>| cells.iter().map(|&i| &self.cells[i].points[..]).collect();
        let pages: Vec<(usize, Vec<&[u32]>)> = jobs.iter().map(|(page, cells)| (*page, groups(cells))).collect();
        let found = self.pages.measure(&pages, measure)?;
        for ((page, cells), found) in jobs.iter().zip(found) {
            for (&i, size) in cells.iter().zip(found) {
                let cell = &mut self.cells[i];
                if cell.bounds.is_empty() && cell.points.len() >= BOUNDED {
                    cell.bounds = vec![f32::INFINITY; self.pages.pages()];
                }
                cell.measured(*page, size, measure);
            }
        }
        self.pages.done(range)
    }

    /// Splits cells in two.
    fn cut(&mut self, some: &[usize]) -> Result<()> {
        let list = |&i: &usize| {
            let (_, page, dimension) = self.cells[i].size.unwrap_or_default();
            (page, dimension, &self.cells[i].points[..])
        };
        let values = self.pages.values(&some.iter().map(list).collect::<Vec<_>>())?;
        let halves: Vec<[Vec<u32>; 2]> = some
            .par_iter()
            .zip(values)
            .map(|(&i, values)| {
                let cell = &self.cells[i];
                let mut order: Vec<(f32, u32)> = values.into_iter().zip(cell.points.iter().copied()).collect();
                order.sort_by(|a, b| a.0.total_cmp(&b.0));
                let mut low: Vec<u32> = order.into_iter().map(|(_, point)| point).collect();
                let mut high = low.split_off(low.len() / 2);
                low.sort_unstable();
                high.sort_unstable();
                [low, high]
            })
            .collect();
        for (&i, halves) in some.iter().zip(halves) {
            let next = self.cells.len();
            let cell = &mut self.cells[i];
            let (level, limit) = (cell.level + 1, cell.size.map_or(f32::INFINITY, |(size, ..)| size));
            let bounds = std::mem::take(&mut cell.bounds);
            cell.halves = Some([next, next + 1]);
            cell.points = Vec::new();
            for points in halves {
                let bounds = if points.len() < BOUNDED { Vec::new() } else { bounds.clone() };
                self.cells.push(Cell { count: points.len(), points, level, limit, bounds, ..Cell::default() });
            }
        }
        Ok(())
    }

    /// The leaves that remain after splitting boxes one after the other in order of priority.
    fn partition(self) -> Partition {
        let mut waiting = BinaryHeap::new();
        let mut cut = vec![false; self.cells.len()];
        let mut age = 0;
        let mut push = |waiting: &mut BinaryHeap<(Priority, Reverse<usize>, usize)>, i: usize| {
            if let (Some(_), Some(priority)) = (self.cells[i].halves, self.priority(&self.cells[i])) {
                waiting.push((Priority(priority), Reverse(age), i));
            }
            age += 1;
        };
        push(&mut waiting, 0);
        for _ in 1..self.count {
            let Some((_, _, i)) = waiting.pop() else { break };
            cut[i] = true;
            self.cells[i].halves.into_iter().flatten().for_each(|half| push(&mut waiting, half));
        }
        let mut index = vec![0; self.pages.points()];
        let (mut clusters, mut path) = (0, vec![0]);
        while let Some(i) = path.pop() {
            match self.cells[i].halves.filter(|_| cut[i]) {
                Some([low, high]) => path.extend([high, low]),
                None => {
                    self.leaf(i, |point| index[point as usize] = clusters);
                    clusters += 1;
                }
            }
        }
        Partition { index, clusters: clusters as usize }
    }

    /// Calls `f` with all points of a cell.
    fn leaf(&self, i: usize, mut f: impl FnMut(u32)) {
        let mut path = vec![i];
        while let Some(i) = path.pop() {
            match self.cells[i].halves {
                Some(halves) => path.extend(halves),
                None => self.cells[i].points.iter().for_each(|&point| f(point)),
            }
        }
    }
}

#[derive(PartialEq, PartialOrd)]
struct Priority(f64);

impl Eq for Priority {}

#[expect(clippy::derive_ord_xor_partial_ord, reason = "priorities are numbers")]
impl Ord for Priority {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// Points in memory, with a page per dimension.
pub struct Columns {
    /// (dimension, point)
    values: Vec<Vec<f32>>,
}

impl Columns {
    /// Points from values (point, dimension).
    pub fn new(values: &[f32], dimensions: usize) -> Self {
        let column = |d| values.iter().skip(d).step_by(dimensions).copied().collect();
        Self { values: (0..dimensions).map(column).collect() }
    }
}

impl Pages for Columns {
    fn points(&self) -> usize {
        self.values.first().map_or(0, Vec::len)
    }

    fn pages(&self) -> usize {
        self.values.len()
    }

    fn together(&self) -> usize {
        self.values.len().max(1)
    }

    fn measure(&self, pages: &[(usize, Vec<&[u32]>)], measure: Measure) -> Result<Vec<Vec<(f32, usize)>>> {
        let of_page = |(page, groups): &(usize, Vec<&[u32]>)| {
            let column = &self.values[*page];
            groups.iter().map(|points| (size(points.iter().map(|&p| column[p as usize]), measure), 0)).collect()
        };
        Ok(pages.par_iter().map(of_page).collect())
    }

    fn values(&self, lists: &[(usize, usize, &[u32])]) -> Result<Vec<Vec<f32>>> {
        let of_list = |(page, _, points): &(usize, usize, &[u32])| {
            points.iter().map(|&p| self.values[*page][p as usize]).collect()
        };
        Ok(lists.par_iter().map(of_list).collect())
    }

    fn done(&self, _pages: Range<usize>) -> Result<()> {
        Ok(())
    }
}

/// The measure of a list of values.
pub fn size(values: impl Iterator<Item = f32>, measure: Measure) -> f32 {
    match measure {
        Measure::Edge => {
            let (low, high) = values.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            high - low
        }
        Measure::Deviation => {
            let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
            for value in values.map(f64::from) {
                count += 1.0;
                sum += value;
                squares += value * value;
            }
            deviation(count, sum, squares)
        }
    }
}

/// The sum of squared deviations from the mean, from the count, the sum and the sum of squares of the values.
pub fn deviation(count: f64, sum: f64, squares: f64) -> f32 {
    let spread = squares - sum * sum / count;
    // rounding errors of equal values are no deviation
    if spread > 1e-12 * squares { spread as f32 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Integers, many of them equal.
    fn cloud(points: usize, dimensions: usize) -> Vec<f32> {
        let hash = |i: usize| (i.wrapping_mul(0x9E37_79B9).wrapping_add(i >> 3) >> 7) % 64;
        (0..points * dimensions).map(|i| (hash(i) * (1 + i % dimensions) / 3) as f32).collect()
    }

    /// Splits one box after the other.
    fn plain(values: &[f32], dimensions: usize, count: usize, rule: Rule) -> Vec<Vec<u32>> {
        type Plain = (Vec<u32>, u32, Option<(f32, usize)>, usize);
        let measured = |points: &[u32]| {
            let of = |d: usize| size(points.iter().map(|&p| values[p as usize * dimensions + d]), rule.measure());
            (0..dimensions).map(|d| (of(d), d)).filter(|s| s.0 > 0.0).reduce(|a, b| if b.0 > a.0 { b } else { a })
        };
        let all: Vec<u32> = (0..(values.len() / dimensions) as u32).collect();
        let mut boxes: Vec<Plain> = vec![(all.clone(), 0, measured(&all), 0)];
        let mut age = 0;
        while boxes.len() < count {
            let priority = |b: &Plain| b.2.map(|(size, _)| rule.priority(b.1, b.0.len(), size));
            let next = (0..boxes.len()).filter(|&i| priority(&boxes[i]).is_some()).max_by(|&a, &b| {
                let order = priority(&boxes[a]).unwrap().total_cmp(&priority(&boxes[b]).unwrap());
                order.then(boxes[b].3.cmp(&boxes[a].3))
            });
            let Some(next) = next else { break };
            let (mut points, level, cut, _) = boxes.remove(next);
            let dimension = cut.unwrap().1;
            let value = |p: &u32| values[*p as usize * dimensions + dimension];
            points.sort_by(|a, b| value(a).total_cmp(&value(b)).then(a.cmp(b)));
            let high = points.split_off(points.len() / 2);
            for mut half in [points, high] {
                half.sort_unstable();
                age += 1;
                let size = measured(&half);
                boxes.push((half, level + 1, size, age));
            }
        }
        let mut boxes: Vec<Vec<u32>> = boxes.into_iter().map(|b| b.0).collect();
        boxes.sort();
        boxes
    }

    #[test]
    fn passes_give_the_same_boxes_as_single_splits() {
        for rule in [Rule::Balanced, Rule::LongestEdge, Rule::Population, Rule::Variance] {
            for (points, dimensions) in [(1, 1), (2, 3), (300, 9), (1000, 40)] {
                let values = cloud(points, dimensions);
                let columns = Columns::new(&values, dimensions);
                for count in [1, 2, 3, 16, 37, 256] {
                    let found = median_cut(&columns, count, rule).unwrap();
                    let mut members = found.members();
                    members.sort();
                    assert!(members == plain(&values, dimensions, count, rule), "{rule:?} {points} {count}");
                }
            }
        }
    }

    #[test]
    fn halves_have_equal_numbers_of_points_and_lower_ones_come_first() {
        let columns = Columns::new(&[1.0, 1.0, 0.0, 1.0, 0.0, 2.0], 1);
        let index = |count| median_cut(&columns, count, Rule::LongestEdge).unwrap().index;
        assert_eq!(index(2), [0, 1, 0, 1, 0, 1]);
        assert_eq!(index(6), [2, 3, 0, 4, 1, 5]);
        assert_eq!(median_cut(&Columns::new(&[3.0; 9], 1), 4, Rule::Balanced).unwrap().clusters, 1);
    }
}
