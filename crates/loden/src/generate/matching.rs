//! Which row of one material takes the place of each row of another.

use super::rows::Rows;
use super::transport::Plan;
use super::{descriptors, transport};
use crate::Result;

crate::words! {
    /// How rows are matched.
    pub enum Match {
        /// By their numbers.
        Index = "index",
        /// By how bright they are: the darkest with the darkest.
        Brightness = "brightness",
        /// One to one, with the least sum of differences; rows count alike.
        Assignment = "assignment",
        /// By optimal transport of texels: rows count as often as they occur.
        Transport = "transport",
    }
}

/// A row of one material for each row of another.
#[derive(Debug, Clone, PartialEq)]
pub struct Matching {
    /// The row that takes the place of each, or of most of its texels.
    pub rows: Vec<usize>,
    /// For each row, all rows that take its place, and the fractions of its texels that they get.
    pub shares: Vec<Vec<(usize, f64)>>,
    /// The mean squared difference of descriptors, if these were compared.
    pub cost: Option<f64>,
}

impl Matching {
    /// Finds a row of `to` for each row of `from`. Plans are exact; with `epsilon` that of [`Match::Transport`] is regularised. A
    /// row goes where most of its mass goes. Rows of a material are matched with themselves.
    ///
    /// # Model
    /// [`Match::Index`] and [`Match::Brightness`] scale the place in the order to the other number of rows.
    ///
    /// # Errors
    /// As [`transport::plan`] and [`transport::regularised`].
    pub fn new(from: &Rows, to: &Rows, by: Match, epsilon: Option<f64>) -> Result<Self> {
        Self::shared(from, to, by, epsilon).map(|matching| Self::whole(matching.rows, matching.cost))
    }

    /// The same by [`Match::Transport`], but a row is split over all rows that the plan sends its mass to.
    ///
    /// # Errors
    /// As [`Matching::new`].
    pub fn split(from: &Rows, to: &Rows, epsilon: Option<f64>) -> Result<Self> {
        Self::shared(from, to, Match::Transport, epsilon)
    }

    fn shared(from: &Rows, to: &Rows, by: Match, epsilon: Option<f64>) -> Result<Self> {
        let (n, m) = (from.count(), to.count());
        let scaled = |place: usize| place * m / n;
        match by {
            Match::Index => Ok(Self::whole((0..n).map(scaled).collect(), None)),
            Match::Brightness => {
                let [own, other] = [from, to].map(by_brightness);
                let mut rows = vec![0; n];
                own.iter().enumerate().for_each(|(rank, row)| rows[*row] = other[scaled(rank)]);
                Ok(Self::whole(rows, None))
            }
            Match::Assignment | Match::Transport => {
                let [a, b] = [from, to].map(descriptors);
                let cost = |i: usize, j: usize| a[i].distance(&b[j]);
                if a == b {
                    return Ok(Self::whole((0..n).collect(), Some(0.0)));
                }
                let plan = match (by, epsilon) {
                    (Match::Assignment, _) => transport::plan(&vec![1.0; n], &vec![1.0; m], &cost)?,
                    (_, None) => transport::plan(&from.populations(), &to.populations(), &cost)?,
                    (_, Some(epsilon)) => {
                        transport::regularised(&from.populations(), &to.populations(), &cost, epsilon)?
                    }
                };
                Ok(Self::planned(&plan, n, m, &cost))
            }
        }
    }

    /// Every row has one that takes its place.
    fn whole(rows: Vec<usize>, cost: Option<f64>) -> Self {
        let shares = rows.iter().map(|row| vec![(*row, 1.0)]).collect();
        Self { rows, shares, cost }
    }

    /// As a plan says.
    fn planned(plan: &Plan, n: usize, m: usize, cost: &dyn Fn(usize, usize) -> f64) -> Self {
        // rows that no texel has
        let nearest = |i: usize| (0..m).fold(0, |best, j| if cost(i, j) < cost(i, best) { j } else { best });
        let largest = plan.largest(n);
        let rows: Vec<usize> = largest.iter().enumerate().map(|(i, row)| row.unwrap_or_else(|| nearest(i))).collect();
        let mut shares = vec![Vec::new(); n];
        plan.flows.iter().for_each(|flow| shares[flow.from].push((flow.to, flow.mass)));
        for (shares, row) in shares.iter_mut().zip(&rows) {
            let mass: f64 = shares.iter().map(|(_, mass)| mass).sum();
            shares.iter_mut().for_each(|(_, share)| *share /= mass);
            if shares.is_empty() {
                shares.push((*row, 1.0));
            }
        }
        Self { rows, shares, cost: Some(plan.cost) }
    }

    /// The rows that take the place of others, each once.
    pub fn used(&self) -> Vec<usize> {
        let mut used: Vec<usize> = self.shares.iter().flatten().map(|(row, _)| *row).collect();
        used.sort_unstable();
        used.dedup();
        used
    }
}

/// The rows from dark to bright, by mean lightness and then by number.
fn by_brightness(rows: &Rows) -> Vec<usize> {
    let lightness: Vec<f64> = (0..rows.count()).map(|row| super::select::mean_color(rows, row)[0]).collect();
    let mut order: Vec<usize> = (0..rows.count()).collect();
    order.sort_by(|a, b| lightness[*a].total_cmp(&lightness[*b]));
    order
}
