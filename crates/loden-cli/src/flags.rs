//! Command-line flags made from the library's parameter tables, and values several commands share.

use std::collections::BTreeMap;
use std::marker::PhantomData;

use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};
use loden::direction::Scheme;
use loden::material::{Blending, Interpolation};
use loden::params::{Given, Kind, Param, Params, Values};

use crate::choice::{self, Suggestions};
use crate::help;

/// The parameter tables of one kind of thing.
pub trait Tables {
    /// The heading under which help lists the flags; none if a section for each thing lists them ([`crate::help`]).
    const HEADING: Option<&'static str> = None;

    /// (name, parameters) of each thing.
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

impl<T: Tables> Flags<T> {
    /// Themselves as arguments.
    pub fn arguments(&self) -> Vec<String> {
        let tables = T::tables();
        let params = || tables.iter().flat_map(|(_, table)| *table);
        let is_switch = |name: &str| params().any(|param| param.name == name && param.kind == Kind::Switch);
        let argument = |(name, text)| if is_switch(name) { format!("--{name}") } else { format!("--{name}={text}") };
        self.given.iter().map(argument).collect()
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
    fn augment_args(command: Command) -> Command {
        let mut flags: BTreeMap<&str, Vec<Owned>> = BTreeMap::new();
        let tables = T::tables();
        for &(owner, table) in &tables {
            for param in table {
                flags.entry(param.name).or_default().push((owner, param));
            }
        }
        command.args(flags.values().map(|owned| match T::HEADING {
            Some(heading) => listed(owned, tables.len()).help_heading(heading),
            None => unlisted(owned),
        }))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

/// A parameter and what it is of.
type Owned = (&'static str, &'static Param);

/// A flag with help that holds for all its owners, of `all` things.
fn listed(owned: &[Owned], all: usize) -> Arg {
    let (_, first) = owned[0];
    let alike = |(_, param): &Owned| (param.kind, param.default) == (first.kind, first.default);
    let arg = if owned.iter().all(alike) {
        help::option(first)
    } else {
        accepting(owned).help(first.doc.trim_end_matches('.').to_owned())
    };
    // a flag of a few things says which
    if owned.len() > FEW || owned.len() == all {
        return arg;
    }
    let text = arg.get_help().map(ToString::to_string).unwrap_or_default();
    arg.help(format!("{text} ({})", owners(owned)))
}

/// Owners that are named in help, at most.
const FEW: usize = 3;

/// A flag that shells complete and that the sections of a help page explain.
fn unlisted(owned: &[Owned]) -> Arg {
    let (_, first) = owned[0];
    let doc = if owned.iter().all(|(_, param)| param.doc == first.doc) {
        first.doc.trim_end_matches('.').to_owned()
    } else {
        format!("Parameter of {}", owners(owned))
    };
    accepting(owned).help(doc).hide_short_help(true).hide_long_help(true)
}

/// A flag that takes what any of its owners takes; which of that is right is known when the owner is.
fn accepting(owned: &[Owned]) -> Arg {
    let mut words: Vec<&'static str> = Vec::new();
    for (_, param) in owned {
        if let Kind::Choice(choices) = param.kind {
            words.extend(choices.iter().filter(|word| !words.contains(word)).collect::<Vec<_>>());
        }
    }
    let arg = help::bare(owned[0].1);
    match (owned[0].1.kind, words.is_empty()) {
        (Kind::Switch, _) => arg,
        (_, true) => arg.value_name("VALUE"),
        _ => arg.value_name("WORD").value_parser(Suggestions(words)),
    }
}

fn owners(owned: &[Owned]) -> String {
    owned.iter().map(|(owner, _)| *owner).collect::<Vec<_>>().join(", ")
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
        let number =
            |text: &str| text.trim().parse::<f32>().map_err(|_| format!("found {text:?}, a number is expected"));
        let (theta, phi) = (number(theta)?, number(phi)?);
        if !(-90.0..=90.0).contains(&theta) || !phi.is_finite() {
            return Err(format!("the polar angle is {theta}, expected -90..90 degrees from the normal"));
        }
        // a negative polar angle leans to the other side
        Ok(if theta < 0.0 { Self { theta: -theta, phi: phi + 180.0 } } else { Self { theta, phi } })
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

/// How a material finds values between its samples.
#[derive(Debug, Clone, Args)]
pub struct Between {
    /// Interpolation between measured directions.
    #[arg(long, default_value = "triangles")]
    interpolation: SchemeFlag,
    /// What is averaged between directions and texels: linear light, or stored values.
    ///
    /// Light adds linearly; averages of the stored values of photographs are too dark where these differ. `auto` averages
    /// linear light in images and in BTFs compressed to clusters of texels, and stored values in other compressed BTFs,
    /// which are several times slower in linear light. `loden info` says which.
    #[arg(long, value_name = "WORD", default_value = Blending::Auto.name(), value_parser = choice::words(Blending::ALL.iter().map(|word| word.name())))]
    blending: String,
}

/// See [`Scheme`].
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum SchemeFlag {
    /// Linear in triangles of a Delaunay triangulation of the directions.
    Triangles,
    /// Along and between rings of equal polar angle.
    Rings,
}

impl Between {
    pub fn interpolation(&self) -> Interpolation {
        let scheme = match self.interpolation {
            SchemeFlag::Triangles => Scheme::Triangles,
            SchemeFlag::Rings => Scheme::Rings,
        };
        // the words were checked by the parser
        Interpolation { scheme, blending: self.blending.parse().unwrap_or_default() }
    }
}

/// What the files of a measurement may leave unstated: the options of the importers.
pub type Assumptions = Flags<Importers>;

/// All importers.
#[derive(Debug, Clone)]
pub struct Importers;

impl Tables for Importers {
    const HEADING: Option<&'static str> = Some("Conventions of the source, where its files do not state them");

    fn tables() -> Vec<(&'static str, &'static [Param])> {
        loden::import::IMPORTERS.iter().map(|importer| (importer.name(), importer.params())).collect()
    }
}
