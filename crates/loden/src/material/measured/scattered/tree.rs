//! The nearest of scattered points.

use super::place::Place;

/// Number of neighbours that a search finds.
pub const NEIGHBOURS: usize = 12;

/// The nearest points found so far, ascending: (square of the distance, point). There is one more than neighbours.
#[derive(Default)]
pub struct Nearest {
    pub list: [(f32, u32); NEIGHBOURS + 1],
    pub count: usize,
}

impl Nearest {
    fn worst(&self) -> f32 {
        if self.count <= NEIGHBOURS { f32::INFINITY } else { self.list[NEIGHBOURS].0 }
    }

    fn insert(&mut self, square: f32, point: u32) {
        if square >= self.worst() {
            return;
        }
        let at = self.list[..self.count].partition_point(|p| p.0 <= square);
        self.count = (self.count + 1).min(NEIGHBOURS + 1);
        self.list[at..self.count].rotate_right(1);
        self.list[at] = (square, point);
    }
}

/// A k-d tree without pointers: the median splits each part, along alternating axes.
#[derive(Debug, Clone)]
pub struct Tree {
    points: Vec<(Place, u32)>,
    axes: usize,
}

impl Tree {
    /// From points with so many coordinates; the others are 0.
    pub fn new(points: &[Place], axes: usize) -> Self {
        let mut points: Vec<_> = points.iter().copied().zip(0..).collect();
        build(&mut points, 0, axes);
        Self { points, axes }
    }

    /// Finds the points nearest to `at`.
    pub fn search(&self, at: &Place) -> Nearest {
        let mut nearest = Nearest::default();
        self.descend(&self.points, 0, at, &mut nearest);
        nearest
    }

    fn descend(&self, points: &[(Place, u32)], axis: usize, at: &Place, nearest: &mut Nearest) {
        let middle = points.len() / 2;
        let Some((point, number)) = points.get(middle) else { return };
        nearest.insert(distance_squared(point, at), *number);
        let (low, high) = (&points[..middle], &points[middle + 1..]);
        let side = at[axis] - point[axis];
        let (near, far) = if side < 0.0 { (low, high) } else { (high, low) };
        let next = (axis + 1) % self.axes;
        self.descend(near, next, at, nearest);
        if side * side < nearest.worst() {
            self.descend(far, next, at, nearest);
        }
    }
}

fn build(points: &mut [(Place, u32)], axis: usize, axes: usize) {
    if points.len() < 2 {
        return;
    }
    let middle = points.len() / 2;
    // Break ties by index, so that the tree depends only on the samples
    points.select_nth_unstable_by(middle, |a, b| a.0[axis].total_cmp(&b.0[axis]).then(a.1.cmp(&b.1)));
    let (low, high) = points.split_at_mut(middle);
    build(low, (axis + 1) % axes, axes);
    build(&mut high[1..], (axis + 1) % axes, axes);
}

/// The square of the distance of two points.
pub fn distance_squared(a: &Place, b: &Place) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}
