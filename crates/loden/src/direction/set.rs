//! Sampled direction sets: ordered lists of directions, with names for those of known goniometers.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::from_angles;
use crate::{Error, Result};

/// (theta, first azimuth, count), angles in degrees; azimuths are 360 / count apart.
type Ring = (f64, f64, usize);

const BONN81: &[Ring] =
    &[(0.0, 0.0, 1), (15.0, 0.0, 6), (30.0, 0.0, 12), (45.0, 0.0, 18), (60.0, 0.0, 20), (75.0, 0.0, 24)];

const UBO2014: &[Ring] = &[
    (0.0, 0.0, 1),
    (11.0, 15.0, 6),
    (23.5, 0.0, 12),
    (30.0, 15.0, 12),
    (37.5, 0.0, 12),
    (45.0, 0.0, 18),
    (52.5, 7.5, 18),
    (60.0, 0.0, 24),
    (67.5, 7.5, 24),
    (75.0, 0.0, 24),
];

/// Known sets, by the name under which they are stored.
const NAMED: &[(&str, &[Ring])] = &[("bonn81", BONN81), ("ubo2014", UBO2014)];

/// An ordered list of sampled directions of the upper hemisphere, never empty.
///
/// The lights of a BTF with its own list of pairs also have the view that each of them is seen from
/// ([`DirectionSet::seen_from`]).
///
/// Serialised as the name of a known set, or as a list of (theta, phi) in degrees; pairs as a list of (theta and phi of the
/// light, theta and phi of the view).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "Stored", try_from = "Stored")]
pub struct DirectionSet {
    degrees: Vec<[f64; 2]>,
    directions: Vec<Vec3>,
    /// The view of each light.
    seen_from: Option<Box<DirectionSet>>,
}

impl DirectionSet {
    /// The 81 directions of the Bonn goniometer (UBO2003), ring by ring.
    pub fn bonn81() -> Self {
        Self::rings(BONN81)
    }

    /// The 151 directions of the Bonn dome (UBO2014), ring by ring.
    pub fn ubo2014() -> Self {
        Self::rings(UBO2014)
    }

    /// A single direction, the normal.
    pub fn normal() -> Self {
        Self::rings(&[(0.0, 0.0, 1)])
    }

    /// The names of the known sets.
    pub fn names() -> impl Iterator<Item = &'static str> {
        NAMED.iter().map(|(name, _)| *name)
    }

    /// The known set of this name.
    pub fn named(name: &str) -> Option<Self> {
        NAMED.iter().find(|(n, _)| *n == name).map(|(_, rings)| Self::rings(rings))
    }

    /// A set from a list of (theta, phi) in degrees.
    ///
    /// # Errors
    /// [`Error::Parameter`] if the list is empty, an angle is not finite, or theta is outside 0..=90.
    pub fn from_degrees(degrees: Vec<[f64; 2]>) -> Result<Self> {
        if degrees.is_empty() {
            return Err(Error::parameter("directions", "the list is empty"));
        }
        if let Some([t, p]) = degrees.iter().find(|[t, p]| !(0.0..=90.0).contains(t) || !p.is_finite()) {
            return Err(Error::parameter(
                "directions",
                format!("found ({t}, {p}), expected a polar angle in 0..=90 and an azimuth, in degrees"),
            ));
        }
        let directions =
            degrees.iter().map(|[t, p]| from_angles(t.to_radians() as f32, p.to_radians() as f32)).collect();
        Ok(Self { degrees, directions, seen_from: None })
    }

    /// Lights, each with the view that it is seen from: (theta, phi) of the light and (theta, phi) of the view, in degrees.
    ///
    /// # Errors
    /// As [`DirectionSet::from_degrees`].
    pub fn of_pairs(degrees: &[[f64; 4]]) -> Result<Self> {
        let views = Self::from_degrees(degrees.iter().map(|d| [d[2], d[3]]).collect())?;
        let lights = Self::from_degrees(degrees.iter().map(|d| [d[0], d[1]]).collect())?;
        Ok(Self { seen_from: Some(Box::new(views)), ..lights })
    }

    /// The view of each light, if these are the lights of a BTF with its own list of pairs.
    pub fn seen_from(&self) -> Option<&Self> {
        self.seen_from.as_deref()
    }

    fn rings(rings: &[Ring]) -> Self {
        let ring = |&(theta, start, count): &Ring| {
            (0..count).map(move |k| [theta, (start + 360.0 * k as f64 / count as f64) % 360.0])
        };
        let degrees: Vec<_> = rings.iter().flat_map(ring).collect();
        let directions =
            degrees.iter().map(|[t, p]| from_angles(t.to_radians() as f32, p.to_radians() as f32)).collect();
        Self { degrees, directions, seen_from: None }
    }

    /// The name, if this is a known set in its known order. Angles may differ by 0.01 degrees.
    pub fn name(&self) -> Option<&'static str> {
        let close = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).abs() < 0.01 && (a[1] - b[1]).abs() < 0.01;
        let same = |rings: &[Ring]| {
            let known = Self::rings(rings);
            known.len() == self.len() && known.degrees.iter().zip(&self.degrees).all(|(a, b)| close(a, b))
        };
        let known = || NAMED.iter().find(|(_, rings)| same(rings)).map(|(name, _)| *name);
        if self.seen_from.is_some() { None } else { known() }
    }

    /// Number of directions.
    pub fn len(&self) -> usize {
        self.directions.len()
    }

    /// Whether there are no directions; never true.
    pub fn is_empty(&self) -> bool {
        self.directions.is_empty()
    }

    /// Unit vectors, in order.
    pub fn directions(&self) -> &[Vec3] {
        &self.directions
    }

    /// (theta, phi) in degrees, in order.
    pub fn degrees(&self) -> &[[f64; 2]] {
        &self.degrees
    }

    /// The index of the direction nearest to the unit vector `w`; the first of equals.
    pub fn nearest(&self, w: Vec3) -> usize {
        let dot = |i: &usize| self.directions[*i].dot(w);
        (0..self.len()).rev().max_by(|a, b| dot(a).total_cmp(&dot(b))).unwrap_or(0)
    }
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Stored {
    Name(String),
    List(Vec<[f64; 2]>),
    Pairs(Vec<[f64; 4]>),
}

impl From<DirectionSet> for Stored {
    fn from(set: DirectionSet) -> Self {
        if let Some(views) = set.seen_from {
            let pairs = set.degrees.iter().zip(&views.degrees);
            return Stored::Pairs(pairs.map(|(light, view)| [light[0], light[1], view[0], view[1]]).collect());
        }
        set.name().map_or(Stored::List(set.degrees), |name| Stored::Name(name.into()))
    }
}

impl TryFrom<Stored> for DirectionSet {
    type Error = Error;
    fn try_from(stored: Stored) -> Result<Self> {
        match stored {
            Stored::List(list) => Self::from_degrees(list),
            Stored::Pairs(list) => Self::of_pairs(&list),
            Stored::Name(name) => Self::named(&name).ok_or_else(|| {
                let known: Vec<_> = NAMED.iter().map(|(n, _)| *n).collect();
                Error::parameter("directions", format!("found {name:?}, expected one of {}", known.join(", ")))
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_sets_have_their_sizes_and_names() {
        for (name, count) in [("bonn81", 81), ("ubo2014", 151)] {
            let set = DirectionSet::named(name).unwrap();
            assert_eq!((set.len(), set.name()), (count, Some(name)));
            let json = serde_json::to_string(&set).unwrap();
            assert_eq!(json, format!("{name:?}"));
            assert_eq!(serde_json::from_str::<DirectionSet>(&json).unwrap(), set);
        }
    }

    #[test]
    fn lists_round_trip_and_bad_ones_are_refused() {
        let set = DirectionSet::from_degrees(vec![[0.0, 0.0], [45.0, 12.5]]).unwrap();
        let json = serde_json::to_string(&set).unwrap();
        assert_eq!(serde_json::from_str::<DirectionSet>(&json).unwrap(), set);
        for bad in ["[]", "[[91.0, 0.0]]", "\"bonn82\""] {
            assert!(serde_json::from_str::<DirectionSet>(bad).is_err(), "{bad}");
        }
        assert!(DirectionSet::from_degrees(vec![[f64::NAN, 0.0]]).is_err());
    }

    #[test]
    fn pairs_round_trip() {
        let set = DirectionSet::of_pairs(&[[0.0, 0.0, 45.0, 10.0], [30.0, 20.0, 60.0, 90.0]]).unwrap();
        let json = serde_json::to_string(&set).unwrap();
        assert_eq!(json, "[[0.0,0.0,45.0,10.0],[30.0,20.0,60.0,90.0]]");
        assert_eq!(serde_json::from_str::<DirectionSet>(&json).unwrap(), set);
        assert_eq!(set.seen_from().unwrap().degrees()[1], [60.0, 90.0]);
        for bad in ["[[0.0,0.0,95.0,10.0]]", "[[0.0,0.0,45.0]]", "[[0.0,0.0],[0.0,0.0,45.0,10.0]]"] {
            assert!(serde_json::from_str::<DirectionSet>(bad).is_err(), "{bad}");
        }
        // the view at every light counts
        let other = DirectionSet::of_pairs(&[[0.0, 0.0, 45.0, 10.0], [30.0, 20.0, 60.0, 91.0]]).unwrap();
        assert_ne!(set, other);
    }

    #[test]
    fn nearest_finds_each_direction_itself() {
        let set = DirectionSet::bonn81();
        for (i, &w) in set.directions().iter().enumerate() {
            assert_eq!(set.nearest(w), i);
        }
    }
}
