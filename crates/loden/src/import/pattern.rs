//! Picture files matched by a pattern of named numbers, and the directions that the numbers denote.

use std::collections::BTreeMap;
use std::path::Path;

use super::located;
use crate::direction::DirectionSet;
use crate::input::files_below;
use crate::{Error, Result};

/// The names allowed in patterns: indices of directions, angles in degrees, and numbers to be ignored.
pub(crate) const NAMES: [&str; 8] = ["view", "light", "pair", "theta_v", "phi_v", "theta_l", "phi_l", "any"];

/// The files below the folder of the manifest `path` that match the pattern, sorted by name; at least one.
pub(crate) fn list(path: &Path, pattern: &Pattern, text: &str) -> Result<Vec<(String, Numbers)>> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let files = files_below(folder)?.into_iter();
    let found: Vec<_> =
        files.filter_map(|file| pattern.matches(&file.name).map(|numbers| (file.name, numbers))).collect();
    if found.is_empty() {
        return Err(Error::invalid(path, "files", format!("found no file that matches {text:?}")));
    }
    Ok(found)
}

/// The numbers in a file's name.
pub(crate) type Numbers = BTreeMap<String, f64>;

/// The directions of views or lights, and the direction of each file.
pub(crate) struct Side {
    pub set: DirectionSet,
    pub of_file: Vec<usize>,
}

impl Side {
    /// Takes directions from the given lists, or from angles in the names.
    pub(crate) fn new(
        path: &Path,
        field: &str,
        given: Option<DirectionSet>,
        files: &[(String, Numbers)],
        [index, theta, phi]: [&str; 3],
        count_from: usize,
    ) -> Result<Self> {
        let wrong = |problem: String| Error::invalid(path, field, problem);
        let named = &files[0].1;
        if named.contains_key(theta) && named.contains_key(phi) {
            let degrees = |n: &Numbers| [n[theta], n[phi].rem_euclid(360.0)];
            let mut all: Vec<[f64; 2]> = files.iter().map(|(_, n)| degrees(n)).collect();
            all.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
            all.dedup();
            let place = |n: &Numbers| all.iter().position(|d| *d == degrees(n)).unwrap_or(0);
            let of_file = files.iter().map(|(_, n)| place(n)).collect();
            return Ok(Self { set: DirectionSet::from_degrees(all).map_err(located(path))?, of_file });
        }
        let set = match given {
            Some(set) => set,
            None => DirectionSet::from_degrees(vec![[0.0, 0.0]])?,
        };
        if !named.contains_key(index) {
            let problem = format!("{} directions, but `files` has no {{{index}}} to tell them apart", set.len());
            return if set.len() == 1 { Ok(Self { set, of_file: vec![0; files.len()] }) } else { Err(wrong(problem)) };
        }
        let place = |(name, n): &(String, Numbers)| {
            let place = n[index] - count_from as f64;
            let inside = place >= 0.0 && place.fract() == 0.0 && place < set.len() as f64;
            let problem = format!("{name} has the number {}, but there are {} directions", n[index], set.len());
            if inside { Ok(place as usize) } else { Err(wrong(problem)) }
        };
        let of_file = files.iter().map(place).collect::<Result<_>>()?;
        Ok(Self { set, of_file })
    }
}

/// The lists of directions of a manifest.
pub(crate) struct Lists<'a> {
    pub views: Option<&'a DirectionSet>,
    pub lights: Option<&'a DirectionSet>,
    /// Instead of both.
    pub pairs: Option<&'a DirectionSet>,
}

impl Lists<'_> {
    /// The views and lights of the files. Pairs are lights, all with the same view.
    pub(crate) fn sides(&self, path: &Path, files: &[(String, Numbers)], count_from: usize) -> Result<[Side; 2]> {
        let wrong = |field, problem| Err(Error::invalid(path, field, problem));
        for (field, set) in [("views", self.views), ("lights", self.lights)] {
            if set.is_some_and(|set| set.seen_from().is_some()) {
                return wrong(field, "found four numbers per direction, expected two");
            }
        }
        let side = |field, given: Option<&DirectionSet>, names| {
            Side::new(path, field, given.cloned(), files, names, count_from)
        };
        let has_numbers = files[0].1.contains_key("pair");
        let Some(pairs) = self.pairs else {
            if has_numbers {
                return wrong("pairs", "the list is missing, but `files` has {pair}");
            }
            return Ok([
                side("views", self.views, ["view", "theta_v", "phi_v"])?,
                side("lights", self.lights, ["light", "theta_l", "phi_l"])?,
            ]);
        };
        if pairs.seen_from().is_none() {
            return wrong(
                "pairs",
                "found two numbers per pair, expected four: theta and phi of the light and of the view",
            );
        }
        if self.views.is_some() || self.lights.is_some() {
            return wrong("pairs", "found views or lights beside the list of pairs");
        }
        let views = Side { set: DirectionSet::normal(), of_file: vec![0; files.len()] };
        Ok([views, side("pairs", Some(pairs), ["pair", "", ""])?])
    }
}

/// Whether so many measured pairs of views and lights are kept as a grid: at least half of all. Of a single view all are.
pub(crate) fn is_grid(views: &DirectionSet, measured: usize, pairs: usize) -> bool {
    2 * measured >= pairs || views.len() == 1
}

/// The angles of a pair of views and lights, or of a list of pairs: theta and phi of the light and of the view.
pub(crate) fn pair_degrees(views: &DirectionSet, lights: &DirectionSet, pair: usize) -> [f64; 4] {
    let ([tl, pl], [tv, pv]) = match lights.seen_from() {
        Some(views) => (lights.degrees()[pair], views.degrees()[pair]),
        None => (lights.degrees()[pair % lights.len()], views.degrees()[pair / lights.len()]),
    };
    [tl, pl, tv, pv]
}

/// Alternating text and named numbers.
pub(crate) struct Pattern(Vec<Piece>);

enum Piece {
    Text(String),
    Number(String),
}

impl Pattern {
    /// Parses a pattern whose names are all in `known`.
    pub(crate) fn parse(text: &str, known: &[&str]) -> std::result::Result<Self, String> {
        let mut pieces = Vec::new();
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('{') {
            let (name, behind) = after.split_once('}').ok_or("a { without a matching }")?;
            if !known.contains(&name) {
                return Err(format!("{{{name}}} is not one of {}", known.join(", ")));
            }
            if !before.is_empty() {
                pieces.push(Piece::Text(before.to_owned()));
            } else if matches!(pieces.last(), Some(Piece::Number(_))) {
                return Err(format!("nothing separates {{{name}}} from the number before it"));
            }
            pieces.push(Piece::Number(name.to_owned()));
            rest = behind;
        }
        pieces.push(Piece::Text(rest.to_owned()));
        Ok(Self(pieces))
    }

    /// The numbers in a name that matches the pattern.
    fn matches(&self, name: &str) -> Option<Numbers> {
        let mut numbers = Numbers::new();
        matched(&self.0, name, &mut numbers).then_some(numbers)
    }
}

/// Whether a text matches the pieces; numbers are as long as what follows them allows.
fn matched(pieces: &[Piece], text: &str, numbers: &mut Numbers) -> bool {
    match pieces.split_first() {
        None => text.is_empty(),
        Some((Piece::Text(piece), others)) => {
            text.strip_prefix(piece.as_str()).is_some_and(|rest| matched(others, rest, numbers))
        }
        Some((Piece::Number(name), others)) => {
            let sign = usize::from(text.starts_with('-'));
            let digits = |c: char| !c.is_ascii_digit() && c != '.';
            let longest = sign + text[sign..].find(digits).unwrap_or(text.len() - sign);
            // a dot may begin the following text, such as the extension
            (sign + 1..=longest).rev().any(|end| {
                let Ok(value) = text[..end].parse::<f64>() else { return false };
                let before = numbers.get(name).copied();
                if name != "any" {
                    if before.is_some_and(|other| other != value) {
                        return false;
                    }
                    numbers.insert(name.clone(), value);
                }
                let fits = matched(others, &text[end..], numbers);
                if !fits && before.is_none() {
                    numbers.remove(name);
                }
                fits
            })
        }
    }
}
