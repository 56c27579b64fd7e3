//! Command-line flags made from the library's parameter tables, and values several commands share.

use std::collections::BTreeMap;
use std::marker::PhantomData;

use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};
use loden::params::{Given, Kind, Param, Params, Values};

/// The tables of one kind of thing: (its name, its parameters).
pub trait Tables {
    fn tables() -> Vec<(&'static str, &'static [Param])>;
}

/// Flags for all parameters of a kind of thing; which of them a chosen one knows is checked by [`Flags::values`].
#[derive(Debug, Clone)]
pub struct Flags<T> {
    given: Given,
    kind: PhantomData<T>,
}

impl<T> Flags<T> {
    /// What the user gave.
    pub fn given(&self) -> &Given {
        &self.given
    }

    /// Themselves as arguments.
    pub fn arguments(&self) -> Vec<String> {
        self.given.iter().map(|(name, text)| format!("--{name}={text}")).collect()
    }

    /// The flags of `table`, and the others.
    pub fn split(&self, table: &[Param]) -> (Self, Self) {
        let (inside, outside) = self.given.split(table);
        (Self { given: inside, kind: PhantomData }, Self { given: outside, kind: PhantomData })
    }

    /// The values for `table`.
    pub fn values(&self, table: &'static [Param]) -> loden::Result<Values> {
        self.given.values(table)
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
        let given = names.filter_map(|name| Some((name, matches.get_one::<String>(name)?)));
        let given = given.fold(Given::default(), |given, (name, text)| given.with(name, text));
        Ok(Self { given, kind: PhantomData })
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
            let (doc, owners) = (param.doc.trim_end_matches('.'), owners.join(", "));
            let arg = Arg::new(name).long(name).help_heading("Parameters");
            command = command.arg(match param.kind {
                Kind::Switch => arg.num_args(0).default_missing_value("yes").help(format!("{doc} ({owners})")),
                kind => {
                    let default = if default.is_empty() { String::new() } else { format!(" [default: {default}]") };
                    let help = format!("{doc} ({}{unit}; {owners}){default}", range(kind));
                    arg.value_name("VALUE").help(help).allow_negative_numbers(true)
                }
            });
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

/// What the files of a measurement may leave unstated: the options of the importers.
pub type Assumptions = Flags<Importers>;

/// All importers.
#[derive(Debug, Clone)]
pub struct Importers;

impl Tables for Importers {
    fn tables() -> Vec<(&'static str, &'static [Param])> {
        loden::import::IMPORTERS.iter().map(|importer| (importer.name(), importer.params())).collect()
    }
}
