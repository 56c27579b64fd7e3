//! Command-line flags made from the library's parameter tables, and values several commands share.

use std::collections::BTreeMap;
use std::marker::PhantomData;

use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};
use loden::params::{Kind, Param, Params, Values};

/// The tables of one kind of thing: (its name, its parameters).
pub trait Tables {
    fn tables() -> Vec<(&'static str, &'static [Param])>;
}

/// Flags for all parameters of a kind of thing; which of them a chosen one knows is checked by [`Flags::values`].
#[derive(Debug, Clone)]
pub struct Flags<T> {
    given: BTreeMap<String, String>,
    kind: PhantomData<T>,
}

impl<T> Flags<T> {
    /// The flags of `table`, and the others.
    pub fn split(&self, table: &[Param]) -> (Self, Self) {
        let known = |name: &String| table.iter().any(|param| param.name == name);
        let (inside, outside) = self.given.clone().into_iter().partition(|(name, _)| known(name));
        (Self { given: inside, kind: PhantomData }, Self { given: outside, kind: PhantomData })
    }

    /// The values for `table`.
    pub fn values(&self, table: &'static [Param]) -> loden::Result<Values> {
        Values::new(table, self.given.iter().map(|(name, text)| (name.as_str(), text.as_str())))
    }
}

impl<T> Flags<T> {
    /// The struct of the flags.
    pub fn read<P: Params>(&self) -> loden::Result<P> {
        P::from_values(&self.values(P::TABLE)?)
    }
}

impl<T: Tables> FromArgMatches for Flags<T> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let names = T::tables().into_iter().flat_map(|(_, table)| table).map(|param| param.name);
        let given = names.filter_map(|name| Some((name.to_owned(), matches.get_one::<String>(name)?.clone())));
        Ok(Self { given: given.collect(), kind: PhantomData })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl<T: Tables> Args for Flags<T> {
    fn augment_args(mut command: Command) -> Command {
        let mut help: BTreeMap<&str, Vec<(&str, Param)>> = BTreeMap::new();
        for (owner, table) in T::tables() {
            for param in table {
                help.entry(param.name).or_default().push((owner, *param));
            }
        }
        for (name, owned) in help {
            let param = owned[0].1;
            let default = if owned.iter().all(|(_, other)| other.default == param.default) {
                param.default.to_owned()
            } else {
                let each = |(owner, param): &(&str, Param)| format!("{} for {owner}", param.default);
                owned.iter().map(each).collect::<Vec<_>>().join(", ")
            };
            let owners: Vec<&str> = owned.iter().map(|(owner, _)| *owner).collect();
            let unit = if param.unit.is_empty() { String::new() } else { format!(", {}", param.unit) };
            let text = format!(
                "{} ({}{unit}; {}) [default: {}]",
                param.doc.trim_end_matches('.'),
                range(param.kind),
                owners.join(", "),
                default
            );
            command = command.arg(
                Arg::new(name)
                    .long(name)
                    .value_name("VALUE")
                    .help(text)
                    .help_heading("Parameters")
                    .allow_negative_numbers(true),
            );
        }
        command
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

fn range(kind: Kind) -> String {
    match kind {
        Kind::Integer { min, max } => format!("{min}..{max}"),
        Kind::Real { min, max } => format!("{min}..{max}"),
        Kind::Color { min, max } => format!("{min}..{max}, or red,green,blue"),
        Kind::Choice(words) => words.join("|"),
        Kind::Switch => "yes|no".into(),
        Kind::Text(form) => form.expected.into(),
    }
}

/// A direction given as `polar angle,azimuth` in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Angles {
    pub theta: f32,
    pub phi: f32,
}

impl std::str::FromStr for Angles {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let (theta, phi) = text.split_once(',').ok_or("two angles are expected: polar angle,azimuth")?;
        let number = |text: &str| text.trim().parse::<f32>().map_err(|e| format!("{text:?}: {e}"));
        let angles = Self { theta: number(theta)?, phi: number(phi)? };
        if !(0.0..=90.0).contains(&angles.theta) || !angles.phi.is_finite() {
            return Err(format!("the polar angle is {}, expected 0..90 degrees from the normal", angles.theta));
        }
        Ok(angles)
    }
}

impl Angles {
    pub fn direction(self) -> glam::Vec3 {
        loden::direction::from_angles(self.theta.to_radians(), self.phi.to_radians())
    }
}

/// A picture size given as `WIDTHxHEIGHT` or one number for both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Size {
    pub width: usize,
    pub height: usize,
}

impl std::str::FromStr for Size {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let (width, height) = text.split_once('x').unwrap_or((text, text));
        let number = |text: &str| text.parse::<usize>().ok().filter(|n| (1..=16384).contains(n));
        match (number(width), number(height)) {
            (Some(width), Some(height)) => Ok(Self { width, height }),
            _ => Err("a size such as 512x384 is expected, each side 1..16384".into()),
        }
    }
}

/// What the files of a measurement may leave unstated.
#[derive(Debug, Clone, Copy, Args)]
pub struct Assumptions {
    /// How the files encode light: srgb, linear, or gamma and a number (gamma2.2) [default: what the file states, else srgb].
    #[arg(long)]
    pub encoding: Option<loden::color::Encoding>,
    /// Whether the light's cosine is in the values: included or excluded [default: what the file states, else included].
    #[arg(long)]
    pub cosine: Option<CosineFlag>,
    /// The sense in which azimuths count, seen from above: ccw or cw.
    #[arg(long, default_value = "ccw")]
    pub azimuth: AzimuthFlag,
    /// Which row of the picture comes first in a .btf file [default: bottom].
    #[arg(long)]
    pub first_row: Option<FirstRowFlag>,
    /// Which material of a file that holds several, by its number in the file [default: the first].
    #[arg(long, value_name = "N")]
    pub index: Option<usize>,
    /// The file's differences of azimuth count from the mirror side (some ALTA files).
    #[arg(long)]
    pub phi_from_mirror: bool,
}

/// See [`loden::btf::Cosine`].
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum CosineFlag {
    Included,
    Excluded,
}

/// See [`loden::import::Azimuth`].
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum AzimuthFlag {
    Ccw,
    Cw,
}

/// See [`loden::import::FirstRow`].
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum FirstRowFlag {
    Bottom,
    Top,
}

/// A flag with one of its words.
fn word(name: &str, value: impl clap::ValueEnum) -> Option<String> {
    Some(format!("--{name}={}", value.to_possible_value()?.get_name()))
}

impl Assumptions {
    /// Itself as flags.
    pub fn flags(&self) -> Vec<String> {
        let encoding = self.encoding.map(|encoding| format!("--encoding={encoding}"));
        let cosine = self.cosine.and_then(|flag| word("cosine", flag));
        let first_row = self.first_row.and_then(|flag| word("first-row", flag));
        let index = self.index.map(|index| format!("--index={index}"));
        let mirror = self.phi_from_mirror.then(|| "--phi-from-mirror".to_owned());
        [encoding, cosine, word("azimuth", self.azimuth), first_row, index, mirror].into_iter().flatten().collect()
    }

    pub fn options(self) -> loden::import::Options {
        loden::import::Options {
            encoding: self.encoding,
            cosine: self.cosine.map(|cosine| match cosine {
                CosineFlag::Included => loden::btf::Cosine::Included,
                CosineFlag::Excluded => loden::btf::Cosine::Excluded,
            }),
            azimuth: match self.azimuth {
                AzimuthFlag::Ccw => loden::import::Azimuth::Counterclockwise,
                AzimuthFlag::Cw => loden::import::Azimuth::Clockwise,
            },
            first_row: self.first_row.map(|row| match row {
                FirstRowFlag::Bottom => loden::import::FirstRow::Bottom,
                FirstRowFlag::Top => loden::import::FirstRow::Top,
            }),
            index: self.index,
            phi_from_mirror: self.phi_from_mirror,
        }
    }
}
