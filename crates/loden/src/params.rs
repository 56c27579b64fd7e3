//! Parameters declared once: one declaration gives a struct with typed fields and the table that drives command-line
//! flags, stored metadata and reference pages.
//!
//! Codecs, models and the like declare their parameters with [`params!`](crate::params!). [`Values`] checks and parses what
//! the user wrote; each job reads its own struct from them when it begins:
//!
//! ```
//! use loden::params::{Params, Values};
//!
//! loden::words! {
//!     /// Colour of the dye.
//!     pub enum Dye { Brown = "brown", Black = "black" }
//! }
//!
//! loden::params! {
//!     /// The parameters of a leather.
//!     pub struct Leather {
//!         /// Grains per side of the tile.
//!         pub cells: usize [4..=64] = 13,
//!         /// Colour of the dye.
//!         pub dye: Dye = "brown",
//!         /// Pitch of the stitches.
//!         pub stitch_pitch: f64 [0.5..=20.0, "mm"] = 3,
//!         /// Length of a thread; unlimited by default.
//!         pub thread: Option<f64> [0.0..=1e4, "m"],
//!     }
//! }
//!
//! let values = Values::new(Leather::TABLE, [("stitch-pitch", "2.5")])?;
//! let leather = Leather::from_values(&values)?;
//! assert_eq!((leather.cells, leather.dye, leather.stitch_pitch), (13, Dye::Brown, 2.5));
//! assert!(Values::new(Leather::TABLE, [("cells", "65")]).is_err());
//! # loden::Result::Ok(())
//! ```

mod part;
mod typed;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::OnceLock;

use serde::ser::{Serialize, SerializeMap, Serializer};

#[doc(hidden)]
pub use crate::parameter_name as name;
#[doc(hidden)]
pub use part::{Part, flatten, kebab, length};
pub use typed::{Field, Params, Type, YesNo};

use crate::{Error, Result};

/// What a parameter may hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Kind {
    /// A whole number in an inclusive range.
    Integer {
        /// Smallest value.
        min: i64,
        /// Largest value.
        max: i64,
    },
    /// A real number in an inclusive range.
    Real {
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
    },
    /// Three real numbers, red, green and blue, each in an inclusive range; one number stands for all three.
    Color {
        /// Smallest value of a channel.
        min: f64,
        /// Largest value of a channel.
        max: f64,
    },
    /// One of several words.
    Choice(&'static [&'static str]),
    /// `yes` or `no`; on the command line a flag without a value.
    Switch,
    /// Text in a form that its type checks, such as a colour encoding.
    Text(Form),
}

/// A form of text.
#[derive(Debug, Clone, Copy)]
pub struct Form {
    /// The form, as error messages name it.
    pub expected: &'static str,
    /// Texts of this form, offered by the completion of shells.
    pub examples: &'static [&'static str],
    /// Whether a text is of this form.
    pub accepts: fn(&str) -> bool,
}

impl PartialEq for Form {
    /// Compares forms by their description.
    fn eq(&self, other: &Self) -> bool {
        self.expected == other.expected
    }
}

/// A parsed value of any [`Kind`]. It is serialised as a number, three numbers, a string or a Boolean.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[serde(untagged)]
pub enum Value {
    /// A value of [`Kind::Integer`].
    Integer(i64),
    /// A value of [`Kind::Real`].
    Real(f64),
    /// A value of [`Kind::Color`]: red, green, blue.
    Color([f64; 3]),
    /// A value of [`Kind::Choice`] or [`Kind::Text`].
    Word(String),
    /// A value of [`Kind::Switch`].
    Switch(bool),
}

/// The value as a user would write it; a grey is one number.
impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Integer(value) => write!(f, "{value}"),
            Self::Real(value) => write!(f, "{value}"),
            Self::Color([r, g, b]) if r == g && g == b => write!(f, "{r}"),
            Self::Color([r, g, b]) => write!(f, "{r},{g},{b}"),
            Self::Word(word) => f.write_str(word),
            Self::Switch(on) => f.write_str(if *on { "yes" } else { "no" }),
        }
    }
}

/// One parameter of a codec, sample or model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Param {
    /// Name of the parameter, as users write it: the command-line flag without its dashes, the key in stored
    /// metadata.
    pub name: &'static str,
    /// The unit, empty if none.
    pub unit: &'static str,
    /// Type and range.
    pub kind: Kind,
    /// The default as a user would write it.
    pub default: &'static str,
    /// One sentence of help.
    pub doc: &'static str,
}

impl Param {
    /// Checks that `text` is a value of this parameter.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming the parameter, what was found and what is allowed.
    pub fn check(&self, text: &str) -> Result<()> {
        self.parse(text).map(drop)
    }

    /// The value that `text` denotes.
    ///
    /// # Errors
    /// As [`Param::check`].
    pub fn parse(&self, text: &str) -> Result<Value> {
        let value = match self.kind {
            Kind::Integer { .. } => text.parse().ok().map(Value::Integer),
            Kind::Real { .. } => text.parse().ok().map(Value::Real),
            Kind::Color { .. } => color(text).map(Value::Color),
            Kind::Choice(_) | Kind::Text(_) => Some(Value::Word(text.into())),
            Kind::Switch => ["no", "yes"].iter().position(|word| *word == text).map(|at| Value::Switch(at == 1)),
        };
        value.filter(|value| self.kind.contains(value)).ok_or_else(|| self.mismatch(text))
    }

    fn mismatch(&self, text: &str) -> Error {
        Error::parameter(self.name, format!("found {text:?}, expected {}", self.kind))
    }

    /// Whether the parameter may be left unset: there is no default that the user could write.
    pub fn is_optional(&self) -> bool {
        self.default.is_empty()
    }
}

impl Kind {
    /// Whether `value` is of this kind and in its range.
    fn contains(&self, value: &Value) -> bool {
        match (self, value) {
            (Self::Integer { min, max }, Value::Integer(v)) => (min..=max).contains(&v),
            // no range contains NaN
            (Self::Real { min, max }, Value::Real(v)) => (min..=max).contains(&v),
            (Self::Color { min, max }, Value::Color(rgb)) => rgb.iter().all(|v| (min..=max).contains(&v)),
            (Self::Choice(words), Value::Word(word)) => words.contains(&word.as_str()),
            (Self::Text(form), Value::Word(text)) => (form.accepts)(text),
            (Self::Switch, Value::Switch(_)) => true,
            _ => false,
        }
    }
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Integer { min, max } => write!(f, "a whole number from {min} to {max}"),
            Self::Real { min, max } => write!(f, "a number from {min} to {max}"),
            Self::Color { min, max } => write!(f, "one number or three with commas, each from {min} to {max}"),
            Self::Choice(words) => write!(f, "one of {}", words.join(", ")),
            Self::Switch => f.write_str("yes or no"),
            Self::Text(form) => f.write_str(form.expected),
        }
    }
}

/// One number, or three with commas.
fn color(text: &str) -> Option<[f64; 3]> {
    let numbers = text.split(',').map(|part| part.trim().parse().ok()).collect::<Option<Vec<f64>>>()?;
    match numbers[..] {
        [grey] => Some([grey; 3]),
        [red, green, blue] => Some([red, green, blue]),
        _ => None,
    }
}

/// Checked and parsed values for a table of parameters, with defaults where none is given.
#[derive(Debug, Clone)]
pub struct Values {
    table: &'static [Param],
    /// One per parameter of the table.
    entries: Vec<Entry>,
}

/// The value of one parameter.
#[derive(Debug, Clone)]
struct Entry {
    /// `None` if it is unset.
    value: Option<Value>,
    /// As the user wrote it; for a value that was not text, made on first use.
    text: OnceLock<Cow<'static, str>>,
    is_given: bool,
}

impl Entry {
    fn written(&self) -> &str {
        self.text.get_or_init(|| self.value.as_ref().map(Value::to_string).unwrap_or_default().into())
    }
}

impl PartialEq for Values {
    /// Values are equal if they are written alike.
    fn eq(&self, other: &Self) -> bool {
        self.iter().eq(other.iter())
    }
}

impl Values {
    /// All defaults of `table`.
    pub fn defaults(table: &'static [Param]) -> Self {
        // tests check that every default which is not empty can be parsed
        let default = |param: &Param| Entry {
            value: param.parse(param.default).ok(),
            text: OnceLock::from(Cow::Borrowed(param.default)),
            is_given: false,
        };
        Self { table, entries: table.iter().map(default).collect() }
    }

    /// The defaults of `table`, overridden by `given` (name, value as text).
    ///
    /// # Errors
    /// [`Error::Parameter`] for an unknown name or a value out of range.
    pub fn new<'a>(table: &'static [Param], given: impl IntoIterator<Item = (&'a str, &'a str)>) -> Result<Self> {
        let mut values = Self::defaults(table);
        for (name, text) in given {
            values.set(name, text)?;
        }
        Ok(values)
    }

    /// Sets one value from text.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an unknown name or a value out of range.
    pub fn set(&mut self, name: &str, text: &str) -> Result<()> {
        let at = self.position(name)?;
        let value = self.table[at].parse(text)?;
        let text = OnceLock::from(Cow::Owned(text.into()));
        self.entries[at] = Entry { value: Some(value), text, is_given: true };
        Ok(())
    }

    /// Sets one value without going through text. A real number is accepted for a colour, as it is in text.
    ///
    /// # Errors
    /// [`Error::Parameter`] for an unknown name, or a value of another kind or out of range.
    pub fn set_value(&mut self, name: &str, value: Value) -> Result<()> {
        let at = self.position(name)?;
        let param = &self.table[at];
        let value = match (param.kind, value) {
            (Kind::Color { .. }, Value::Real(grey)) => Value::Color([grey; 3]),
            (_, value) => value,
        };
        if !param.kind.contains(&value) {
            return Err(param.mismatch(&value.to_string()));
        }
        self.entries[at] = Entry { value: Some(value), text: OnceLock::new(), is_given: true };
        Ok(())
    }

    /// Whether `name` was set explicitly, even to its default.
    pub fn is_given(&self, name: &str) -> bool {
        self.position(name).is_ok_and(|at| self.entries[at].is_given)
    }

    /// The value of the parameter `name`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if it does not exist or does not have the type `T`.
    pub fn get<T: Field>(&self, name: &str) -> Result<T> {
        T::read(self, name)
    }

    /// The parsed value of the parameter `name`.
    ///
    /// # Errors
    /// [`Error::Parameter`] if it does not exist or is unset.
    pub fn value(&self, name: &str) -> Result<&Value> {
        let at = self.position(name)?;
        let entry = &self.entries[at];
        entry.value.as_ref().ok_or_else(|| self.table[at].mismatch(entry.written()))
    }

    /// The variant of that name, for the enums of [`words!`](crate::words!).
    #[doc(hidden)]
    pub fn word<T: Copy>(&self, name: &str, all: &[T], word: impl Fn(T) -> &'static str) -> Result<T> {
        let written = self.written(name)?;
        let expected = || all.iter().map(|variant| word(*variant)).collect::<Vec<_>>().join(", ");
        let unknown = || Error::parameter(name, format!("found {written:?}, expected one of {}", expected()));
        all.iter().copied().find(|variant| word(*variant) == written).ok_or_else(unknown)
    }

    /// The value of the parameter `name` as the user would write it; empty if it is unset.
    ///
    /// # Errors
    /// [`Error::Parameter`] if it does not exist.
    pub fn written(&self, name: &str) -> Result<&str> {
        Ok(self.entries[self.position(name)?].written())
    }

    fn position(&self, name: &str) -> Result<usize> {
        let unknown = || {
            let known = self.table.iter().map(|p| p.name).collect::<Vec<_>>().join(", ");
            let known = if known.is_empty() { "there are none".into() } else { format!("there are: {known}") };
            Error::parameter(name, format!("no such parameter; {known}"))
        };
        self.table.iter().position(|p| p.name == name).ok_or_else(unknown)
    }

    /// The table of these values.
    pub fn table(&self) -> &'static [Param] {
        self.table
    }

    /// All names with their values as a user would write them, in the table's order; empty where unset.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, &str)> {
        self.table.iter().zip(&self.entries).map(|(param, entry)| (param.name, entry.written()))
    }

    /// All names with their values, in the table's order, without those that are unset.
    pub fn typed(&self) -> impl Iterator<Item = (&'static str, &Value)> {
        self.table.iter().zip(&self.entries).filter_map(|(param, entry)| Some((param.name, entry.value.as_ref()?)))
    }
}

/// A map from names to [`Value`]s: numbers are numbers.
impl Serialize for Values {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for (name, value) in self.typed() {
            map.serialize_entry(name, value)?;
        }
        map.end()
    }
}

/// Names and texts as the user gave them, before it is known whose parameters they are.
#[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct Given(BTreeMap<String, String>);

impl Given {
    /// Adds a value; it replaces one of the same name.
    pub fn with(mut self, name: impl Into<String>, text: impl Into<String>) -> Self {
        self.0.insert(name.into(), text.into());
        self
    }

    /// The text given for `name`.
    pub fn text(&self, name: &str) -> Option<&str> {
        self.0.get(name).map(String::as_str)
    }

    /// All names and texts, sorted by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str)> {
        self.0.iter().map(|(name, text)| (name.as_str(), text.as_str()))
    }

    /// Splits into what belongs to `table` and the rest.
    pub fn split(&self, table: &[Param]) -> (Self, Self) {
        let known = |(name, _): &(String, String)| table.iter().any(|param| param.name == name);
        let (inside, outside): (BTreeMap<_, _>, BTreeMap<_, _>) = self.0.clone().into_iter().partition(known);
        (Self(inside), Self(outside))
    }

    /// The values for `table`.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a name that is not in the table, or a value out of range.
    pub fn values(&self, table: &'static [Param]) -> Result<Values> {
        Values::new(table, self.iter())
    }
}

impl<const N: usize> From<[(&str, &str); N]> for Given {
    fn from(given: [(&str, &str); N]) -> Self {
        Self(given.map(|(name, text)| (name.into(), text.into())).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: &[Param] = &[
        Param { name: "components", unit: "", kind: Kind::Integer { min: 1, max: 9 }, default: "4", doc: "" },
        Param { name: "precision", unit: "", kind: Kind::Choice(&["f32", "f16"]), default: "f32", doc: "" },
    ];

    #[test]
    fn defaults_are_valid_and_overridable() {
        let values = Values::new(TABLE, [("components", "7")]).unwrap();
        assert_eq!((values.get("components").unwrap(), values.written("precision").unwrap()), (7, "f32"));
    }

    #[test]
    fn a_colour_is_one_number_or_three() {
        const KIND: Kind = Kind::Color { min: 0.0, max: 1.0 };
        let table: &'static [Param] = &[Param { name: "kd", unit: "", kind: KIND, default: "0.5", doc: "" }];
        assert_eq!(Values::defaults(table).get::<[f64; 3]>("kd").unwrap(), [0.5; 3]);
        assert_eq!(Values::new(table, [("kd", "0.1, 0.2,1")]).unwrap().get::<[f64; 3]>("kd").unwrap(), [0.1, 0.2, 1.0]);
        for wrong in ["0.1,0.2", "0,0,1.1", "", "NaN", "red"] {
            assert!(Values::new(table, [("kd", wrong)]).is_err(), "{wrong}");
        }
    }

    #[test]
    fn errors_name_parameter_value_and_range() {
        let error = Values::new(TABLE, [("components", "10")]).unwrap_err().to_string();
        assert_eq!(error, "components: found \"10\", expected a whole number from 1 to 9");
        let error = Values::new(TABLE, [("colour", "1")]).unwrap_err().to_string();
        assert_eq!(error, "colour: no such parameter; there are: components, precision");
    }
}
